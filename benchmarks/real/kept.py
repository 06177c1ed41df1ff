"""The answers that are kept with the benchmark, scored again: a table of the diagnosis and the baselines.

``benchmarks/results/real_today_answers.json`` has the diagnosis's answers with rankings and seconds, as a submission,
``real_today.json`` its score, ``real_baselines.json`` the baselines' answers; ``real_told_answers.json`` those of a
diagnosis that is told each case's effects (``run --told``), to cases that it has not right without.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Final

from benchmarks.machine import RESULTS
from benchmarks.real import submit
from benchmarks.real.cases import CASES
from benchmarks.real.declare import KINDS, RECORDINGS, Case
from benchmarks.real.score import GRADES, RIGHT, Judged, judge

TODAY: Final = "real_today"
ANSWERS: Final = f"{TODAY}_answers"
BASELINES: Final = "real_baselines"
TOLD: Final = "real_told_answers"
_CALLED: Final = {"regression": "regression", "cma": "CMA-ES", "sysid": "`mujoco.sysid`"}


def today() -> dict[str, Any]:
    """The diagnosis's kept answers."""
    return dict(json.loads((RESULTS / f"{ANSWERS}.json").read_text()))


def told() -> dict[str, Any]:
    """The kept answers of a diagnosis that is told which effects to choose from."""
    return dict(json.loads((RESULTS / f"{TOLD}.json").read_text()))


def baselines() -> dict[str, dict[str, Any]]:
    """The baselines' kept answers, by method."""
    return dict(json.loads((RESULTS / f"{BASELINES}.json").read_text())["results"])


def judged(answers: Mapping[str, Any], cases: Sequence[Case]) -> dict[str, Judged]:
    """Cases graded; those without an answer are silent."""
    return {
        case.name: judge(case, submit.answer("kept", case.name, answers[case.name]) if case.name in answers else None)
        for case in cases
    }


def table() -> str:
    """In Markdown: grades of the diagnosis by kind, recording and robot; right answers of every baseline of those that
    it gave, and in brackets how many of these the diagnosis has right."""
    cases = list(CASES.values())
    ours = judged(today(), cases)
    others = {method: (answers, judged(answers, cases)) for method, answers in baselines().items()}
    head = ["", "cases", *GRADES, *(_CALLED[method] for method in others)]
    rows = [head, ["---"] * len(head)]
    groups: list[tuple[str, list[Case]]] = [("all", cases)]
    groups += [(kind, [case for case in cases if case.kind == kind]) for kind in KINDS]
    groups += [(kind, [case for case in cases if case.recording == kind]) for kind in RECORDINGS]
    for robot in dict.fromkeys(case.robot for case in cases):
        groups.append((robot, [case for case in cases if case.robot == robot]))
    for name, some in groups:
        grades = Counter(ours[case.name].grade for case in some)
        row = [name, str(len(some)), *(str(grades[grade]) for grade in GRADES)]
        for answers, theirs in others.values():
            given = [case.name for case in some if case.name in answers]
            right = sum(theirs[case].grade == RIGHT for case in given)
            row.append(
                f"{right} of {len(given)} ({sum(ours[case].grade == RIGHT for case in given)})" if given else "–"
            )
        rows.append(row)
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)
