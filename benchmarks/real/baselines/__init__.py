"""Simple methods on the same cases: what a diagnosis must beat.

    python -m benchmarks.real baseline regression|cma|sysid OUT --data DIR

* ``regression``: ordinary least squares, joint by joint (``regression.py``).
* ``cma``, ``sysid``: a few magnitudes at once, simulated, by CMA-ES or by ``mujoco.sysid`` (``simulation.py``).

They get what ``convert`` writes and nothing else. None names anything by itself: what is taken for its answer is what a
user would read off the fit. A method answers the cases that it can; of the others it says why not.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from benchmarks.real import run
from benchmarks.real.baselines import regression, simulation
from benchmarks.real.baselines.files import NotForThis
from benchmarks.real.declare import Case

METHODS: Final[Mapping[str, Callable[[Case, Path], dict[str, Any]]]] = {
    "regression": regression.answer,
    "cma": simulation.by_cma,
    "sysid": simulation.by_sysid,
}


def answers(
    method: str, cases: Sequence[Case], data: Path, out: Path, told: Callable[[str], None]
) -> dict[str, dict[str, Any]]:
    """A method's answers as a submission, written to ``OUT/METHOD.json`` case by case; goes on where it stopped."""
    path = out / f"{method}.json"
    found: dict[str, dict[str, Any]] = json.loads(path.read_text()) if path.exists() else {}
    for case in cases:
        if case.name in found:
            continue
        folder = out / "cases" / case.name
        run.convert(case, data, folder)
        begun = time.monotonic()
        try:
            said = METHODS[method](case, folder)
        except NotForThis as why:
            told(f"{case.name}: no answer: {why}")
            continue
        found[case.name] = {**said, "seconds": round(time.monotonic() - begun, 1)}
        path.write_text(json.dumps(found, indent=1) + "\n")
        told(f"{case.name}: {', '.join(said['names']) or said['kind']}; {found[case.name]['seconds']:g} s")
    return found
