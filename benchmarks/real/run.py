"""The diagnosis of this package on every case, one after the other; goes on where it stopped.

    OUT/seal.txt                   SHA-256 of the declarations, written before the first diagnosis
    OUT/cases/CASE/                model, recordings, diagnosis, what was printed
    OUT/answers/CASE.json          the answer as a submission has it, with the seal, seconds, ranking

A folder whose seal is not that of the declarations is refused: answers belong to the declarations they were made for.

``told``: the library holds nothing but what the case declares, its causes and what may be named. What such a diagnosis
does not find is no matter of which effects are sought: recordings, nominal model, declared truth, the forms of effects,
or fit and verdict stand against it.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from benchmarks.machine import machine
from benchmarks.real import logs, score
from benchmarks.real.cases import CASES, absent
from benchmarks.real.declare import Case, seal
from benchmarks.user_robots.case import command
from tiago_mj.effects import EFFECTS

SEAL: Final = "seal.txt"
ANSWERS: Final = "answers"

#: Runs ``tiago-mj WORDS`` in a folder; what :func:`benchmarks.user_robots.case.command` says.
Command = Callable[[list[str], Path, Path, float | None], dict[str, Any]]


def begin(out: Path) -> str:
    """Seal a run, or check that the folder's is of these declarations.

    Raises:
        ValueError: it is of others.
    """
    digest = seal(list(CASES.values()))
    path = out / SEAL
    if path.exists():
        if path.read_text().split()[0] != digest:
            raise ValueError(f"{out}: its answers are of other declarations ({SEAL} differs): give a new folder")
    else:
        out.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{digest}  declarations\n")
    return digest


def convert(case: Case, data: Path, folder: Path) -> Path:
    """Write a case's recordings and nominal model; the folder of the recordings.

    Raises:
        ValueError: a recording is missing.
    """
    if missing := absent(case, data):
        raise ValueError(f"{case.name}: {missing[0].place} is not in {data}: fetch it (fetch-list), or give --data")
    shutil.rmtree(folder / logs.RECORDINGS, ignore_errors=True)
    return logs.write(case.read(data), folder, case.model() if case.model else None, case.known)


def diagnose(
    case: Case,
    data: Path,
    out: Path,
    *,
    jobs: int = 1,
    budget: float | None = None,
    told: bool = False,
    run: Command = command,
) -> dict[str, Any]:
    """Answer a case, or read its answer where it has one.

    Args:
        case: which.
        data: the user's folder.
        out: of the run; sealed.
        jobs: of the diagnosis.
        budget: of the diagnosis [s]; None: none.
        told: whether the library holds nothing but what the case declares.
        run: how a command is run.

    Raises:
        ValueError: a recording is missing, or an answer is of other declarations or of another library.
    """
    digest = begin(out)
    kept = out / ANSWERS / f"{case.name}.json"
    if kept.exists():
        found = json.loads(kept.read_text())
        if found["seal"] != digest or found.get("told", False) != told:
            raise ValueError(f"{kept.name}: it is of other declarations, or of another library: give a new folder")
        return dict(found)
    folder = out / "cases" / case.name
    convert(case, data, folder)
    words = ["diagnose", logs.RECORDINGS, "--out", "diagnosis", "--jobs", str(jobs)]
    words += ["--effects", logs.KNOWN] if case.known else []
    words += [] if budget is None else ["--time-budget", f"{budget:g}"]
    words += ["--without", ",".join(sorted(set(EFFECTS) - declared(case)))] if told else []
    said = run(words, folder, folder, budget)
    path = folder / "diagnosis" / "diagnosis.json"
    found = json.loads(path.read_text()) if path.exists() else None
    answer = {
        "case": case.name,
        "seal": digest,
        **({"told": True} if told else {}),
        "answer": score.of_diagnosis(found) if found else None,
        **{key: said.get(key) for key in ("exit_status", "seconds", "lines", "crashed", "last_line")},
        "verdict": found["verdict"] if found else None,
        "complete": found.get("complete", True) if found else None,
        "shrink": {key: found["shrink"].get(key) for key in ("before", "after", "closed")} if found else None,
        "ranking": found["ranking"][:8] if found else [],
        "machine": machine(),
    }
    kept.parent.mkdir(parents=True, exist_ok=True)
    part = kept.with_suffix(".part")
    part.write_text(json.dumps(answer, indent=1) + "\n")
    part.replace(kept)
    return answer


def declared(case: Case) -> set[str]:
    """Effects that a case declares: those that its causes may be called, and what may be named beside them."""
    causes = {name for cause in case.causes for name in (*cause.effects, *(other[0] for other in cause.others))}
    return causes | set(case.may)


def answers(out: Path, cases: Sequence[Case]) -> dict[str, Any]:
    """What a run has answered, as a submission, with seconds and rankings beside what is scored."""
    found = {}
    for case in cases:
        path = out / ANSWERS / f"{case.name}.json"
        if path.exists() and (told := json.loads(path.read_text()))["answer"] is not None:
            found[case.name] = {
                **told["answer"],
                "seconds": told["seconds"],
                **({} if told.get("complete", True) else {"note": "stopped by the time budget: provisional"}),
                "ranking": [
                    {
                        "names": score.names(one["effects"]),
                        **{key: one.get(key) for key in ("probability", "validation_gain")},
                    }
                    for one in told["ranking"]
                ],
            }
    return found
