"""Value of the recommended motion: it is recorded in the reality of the case, and everything is diagnosed again.

An ambiguous case is resolvable where the truth is in its set; it is resolved where the second verdict is the true
class alone.
"""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from numpy.typing import NDArray

from benchmarks.blind import cases, recordings
from benchmarks.blind.cases import Case
from benchmarks.blind.dictionary import PLAIN
from benchmarks.blind.run import Diagnoser, call_command
from benchmarks.blind.score import Judged
from benchmarks.blind.store import Store
from tiago_mj.io import atomic

Array = NDArray[np.float64]

#: So often the motion is played: enough for a train, a validation and a test trial.
REPEATS: Final = 3


def read_motion(path: Path, joints: tuple[str, ...], rate: float, still: Array) -> Array:
    """Commands of every control step, (rows, n), of a motion file (CSV or YAML).

    Args:
        path: with ``time`` [s] and ``command.ACTUATOR``.
        joints: order of the columns; one that the file does not command gets ``still``.
        rate: control rate [Hz].
        still: (n,).
    """
    if path.suffix.lower() in (".yaml", ".yml"):
        table = yaml.safe_load(path.read_text(encoding="utf-8"))
    else:
        with path.open(newline="", encoding="utf-8") as lines:
            rows = list(csv.DictReader(lines))
        table = {name: [row[name] for row in rows] for name in rows[0]}
    time = np.array(table["time"], dtype=np.float64)
    time = time - time[0]
    instants = np.arange(int(np.floor(time[-1] * rate + 1e-6)) + 1) / rate
    held = np.searchsorted(time, instants + 1e-9, side="right") - 1
    out = np.tile(still, (len(instants), 1))
    for column, name in enumerate(joints):
        if f"command.{name}" in table:
            out[:, column] = np.array(table[f"command.{name}"], dtype=np.float64)[held]
    return out


def follow(
    case: Case,
    number: int,
    label: dict[str, Any],
    store: Store,
    diagnoser: Diagnoser,
    *,
    call: Callable[[list[str]], tuple[int, str]] = call_command,
) -> dict[str, Any] | None:
    """Play a case's recommended motion and diagnose again; the outcome is kept in ``next.json``.

    Returns:
        ``resolved`` and the second verdict's kind; None where the case is not ambiguous, the truth is not in its set,
        or nothing is recommended.
    """
    if (done := store.followed(number)) is not None:
        return done
    first = Judged(label, store.answer(number))
    if first.answer is None or first.verdict != "ambiguous" or first.truth not in first.set or len(first.set) < 2:
        return None
    recommended = first.answer.get("next_motion")
    if not recommended:
        return None
    again = store.case(number) / "again"
    shutil.rmtree(again, ignore_errors=True)
    shutil.copytree(store.recordings(number), again / "recordings")
    robot = cases.real_robot(case, again / "recordings")
    motion = Path(str(resources.files("tiago_mj"))) / "recordings" / "motions" / recommended["file"]
    start = cases.setup_of(case, robot, 1, 1, 0).start[0]
    still = np.zeros_like(start) if case.setting != PLAIN and case.interface == "velocity" else start
    commands = read_motion(motion, robot.joints, case.rate, still)
    made = cases.play(case, commands, REPEATS, again / "recordings")
    recordings.write(made, again / "recordings", stem="trial-next")
    status, _ = call(diagnoser.command(case, again / "recordings", again / "diagnosis"))
    second = None
    if status == 0:
        second = json.loads((again / "diagnosis" / "diagnosis.json").read_text())
    then = Judged(label, second)
    outcome = {"resolved": then.verdict == "effect" and then.best == then.truth, "verdict": then.verdict}
    atomic.write_text(store.followed_file(number), json.dumps(outcome, indent=1) + "\n")
    return outcome
