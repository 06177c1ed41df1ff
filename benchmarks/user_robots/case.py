"""One case: recorded, diagnosed by the command line in a process of its own, judged."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from benchmarks.user_robots import record, written
from benchmarks.user_robots.models import USER_ROBOTS

ROOT: Final = Path(__file__).resolve().parents[2]
#: Lines of a command's output that are kept.
KEPT: Final = 60
#: Longest that a command may take, over its budget [s]; without a budget.
OVER: Final = 240.0
LONGEST: Final = 1800.0
#: Effects whose number is that of another one.
COMPARABLE: Final = {"command_delay": ("command_delay", "clock_offset")}


@dataclass(frozen=True)
class Case:
    """What is asked of one set of recordings.

    Attributes:
        model, truth, seed: which.
        logs, seconds, rate: instead of what the seed draws; None: as drawn.
    """

    model: str
    truth: str
    seed: int
    logs: int | None = None
    seconds: float | None = None
    rate: float | None = None

    @property
    def name(self) -> str:
        return f"{self.model}-{self.truth}-{self.seed}"


def run(case: Case, folder: Path, *, budget: float | None, threads: int) -> dict[str, Any]:
    """Record a case, diagnose it, and judge the answer; what is there already is not made again.

    Args:
        case: which.
        folder: of the case: ``work`` is where the user stands, with the model and ``recordings``.
        budget: ``--time-budget`` [s]; None: none.
        threads: ``--jobs`` of the diagnosis; 0: all processors.
    """
    kept = folder / "result.json"
    if kept.exists():
        return json.loads(kept.read_text())
    shutil.rmtree(folder, ignore_errors=True)
    work = folder / "work"
    label = recorded(case, work)
    before = listed(work)
    words = ["diagnose", "recordings", "--out", "diagnosis", "--jobs", str(threads)]
    said = command(words + ([] if budget is None else ["--time-budget", str(budget)]), work, folder, budget)
    left = {name: (work / name).stat().st_size for name in sorted(listed(work) - before)}
    left = {name: size for name, size in left.items() if not name.startswith("diagnosis/")}
    for name in left:
        (work / name).unlink()  # what was left is known by name and size; logs of MuJoCo's warnings fill disks
    answer = work / "diagnosis" / "diagnosis.json"
    found = json.loads(answer.read_text()) if answer.exists() else None
    row = {
        "model": case.model,
        "truth": label,
        "seed": case.seed,
        **judged(case, label, found),
        **said,
        "files_left": left,  # [bytes]
        "half_written": sorted(n for n in listed(work) if n.startswith("diagnosis/") and found is None),
    }
    whole = kept.with_suffix(".part")
    whole.write_text(json.dumps(row, indent=1) + "\n")
    whole.replace(kept)
    return row


def recorded(case: Case, work: Path) -> dict[str, Any]:
    """Write model and recordings; what is true of them."""
    robot = USER_ROBOTS[case.model]
    path = robot.write(work)
    asked = {k: v for k in ("logs", "seconds", "rate") if (v := getattr(case, k)) is not None}
    reality, plan = record.make(robot, case.truth, case.seed, path, asked=asked)
    written.write(reality, plan, case.seed, work / "recordings", f"../{path.name}")
    facts = {"rate_hz": plan.rate, "logs": plan.logs, "seconds_each": plan.seconds}
    return {**reality.truth.label(), **facts}


def listed(folder: Path) -> set[str]:
    """Files below a folder."""
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def command(words: list[str], work: Path, folder: Path, budget: float | None) -> dict[str, Any]:
    """Run ``tiago-mj``: exit status, seconds, lines printed, whether it crashed, and the end of what it said."""
    limit = LONGEST if budget is None else budget + OVER
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    output = folder / "output.txt"
    begun = time.monotonic()
    with output.open("wb") as file:
        child = subprocess.Popen(
            [sys.executable, "-m", "tiago_mj.cli", *words],
            cwd=work,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
        )
        try:
            status: int | None = child.wait(limit)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
            status = None
    seconds = time.monotonic() - begun
    lines, warnings, traceback, end = 0, 0, False, deque[str](maxlen=KEPT)
    with output.open(errors="replace") as text:
        for line in text:
            lines += 1
            warnings += "warning" in line.lower()
            traceback |= line.startswith("Traceback")
            end.append(line[:500])
    output.write_text("".join(end))  # a flood is counted, not kept
    return {
        "exit_status": status,
        "seconds": round(seconds, 1),
        "lines": lines,
        "warnings": warnings,
        "crashed": status != 0 or traceback,  # what is recorded here is never to be refused
        "last_line": next((line.strip() for line in reversed(end) if line.strip()), ""),
    }


def judged(case: Case, label: dict[str, Any], found: dict[str, Any] | None) -> dict[str, Any]:
    """Whether an answer is right by class, and its value within its interval; ``right`` is False without an answer.

    Right is, without an effect, that there is no gap to explain; with one, that the explanation, or one that the data
    are said not to tell from it, has effects of the truth's class and of no other. That encoders are on a grid is true
    of every reality here, and may be named beside anything.
    """
    if found is None:
        return {"verdict": None, "named": [], "right": False, "false_names": []}
    verdict = found["verdict"]
    kind, best = verdict["kind"], verdict["effects"]
    row: dict[str, Any] = {
        "verdict": kind,
        "named": [{"name": one["name"], "target": one["target"]} for one in best],
        "probability": verdict["probability"],
        "complete": found["complete"],
        "closed": found["shrink"]["closed"],
        "own_seconds": found["seconds"],
    }
    named = _beyond_encoders(best) if kind in ("effect", "ambiguous") else []
    if label["kind"] == "none":
        return {**row, "right": kind == "no_gap" or (kind == "effect" and not named), "false_names": named}
    own = classes_of_truth(case, label["effect"])
    sets = [_beyond_encoders(best)]
    if kind == "ambiguous":
        sets += [_beyond_encoders(other["effects"]) for other in verdict["alternatives"]]
    right = kind in ("effect", "ambiguous") and any(some and classes(some) <= own for some in sets)
    row |= {"right": right, "false_names": [name for name in named if not classes([name]) <= own]}
    alike = COMPARABLE.get(label["effect"], (label["effect"],))
    same = next((one for one in best if one["name"] in alike), None)
    if same is not None:
        value = same["parameters"][label["parameter"]]
        low, high, true = value.get("low"), value.get("high"), label["value"]
        row["value"] = {key: value.get(key) for key in ("value", "low", "high", "unit")} | {"truth": true}
        row["within"] = None if low is None or high is None else bool(low <= true <= high)
        targets = same["target"] if isinstance(same["target"], list) else [same["target"]]
        row["target_right"] = label["target"] is None or targets in (["all"], [label["target"]])
    return row


def _beyond_encoders(effects: list[dict[str, Any]]) -> list[str]:
    """Names of effects other than the encoders' grids."""
    return [one["name"] for one in effects if one["name"] != "encoder_quantization"]


def classes(names: list[str]) -> set[str]:
    """Classes of effects, as the library declares them."""
    from tiago_mj.effects import EFFECTS

    return {EFFECTS[name].gap_class for name in names}


def classes_of_truth(case: Case, effect: str) -> set[str]:
    """The class of a truth, and of what is the same in that robot."""
    return classes([effect, *USER_ROBOTS[case.model].same.get(effect, ())])
