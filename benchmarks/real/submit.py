"""Anybody's answers, from a small JSON file.

    {"emps-efforts-friction": {"kind": "effect", "names": ["coulomb_friction@axis", "viscous_friction@axis"],
                               "values": {"coulomb_friction@axis": 20.1, "viscous_friction@axis": 205.0}},
     "emps-efforts-nothing": {"kind": "no_gap", "names": []}}

``kind`` is ``effect``, ``ambiguous``, ``no_gap`` or ``unknown``. A name is an effect of docs/effects.md, with ``@`` and
the joint, or several with ``+``, where the robot has several. Optional are ``values`` (the effect's first parameter),
``remains`` (true: part of the gap is left), ``alternatives`` ([{names, values}]), and what is kept and not scored:
``seconds``, ``ranking`` and ``note``. Cases that are left out count as silent.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from benchmarks.real.cases import CASES
from benchmarks.real.score import VERDICTS, Answer, Judged, Named, judge
from tiago_mj.effects import EFFECTS

_KEYS: Final = {"kind", "names", "values", "remains", "alternatives", "seconds", "ranking", "note"}


class SubmissionError(ValueError):
    """A submission that cannot be scored; one line: what, where, how to mend it."""


def read(path: Path) -> dict[str, Answer]:
    """Answers by case.

    Raises:
        SubmissionError: the file is unusable.
    """
    try:
        whole = json.loads(path.read_text())
    except OSError:
        raise SubmissionError(f"{path}: no such file: give the JSON file of your answers") from None
    except ValueError as fault:
        raise SubmissionError(f"{path.name}: it is no JSON ({str(fault).splitlines()[0]}): mend it there") from None
    if not isinstance(whole, dict):
        raise SubmissionError(f"{path.name}: it holds no object: write {{case: {{kind, names, values}}}}")
    return {name: answer(path.name, name, told) for name, told in whole.items()}


def text(answers: Mapping[str, Any]) -> str:
    """A submission as it is kept: a line a case."""
    lines = (f"{json.dumps(case)}: {json.dumps(told, ensure_ascii=False)}" for case, told in answers.items())
    return "{\n" + ",\n".join(lines) + "\n}\n"


def answer(file: str, case: str, told: Any) -> Answer:
    """One answer.

    Raises:
        SubmissionError: it is unusable.
    """
    where = f"{file}: {case}"
    if case not in CASES:
        raise SubmissionError(f"{where}: no such case: python -m benchmarks.real cases lists them")
    if not isinstance(told, dict):
        raise SubmissionError(f"{where}: it is no object: write {{kind, names, values}}")
    if extra := sorted(set(told) - _KEYS):
        raise SubmissionError(f"{where}: {extra[0]!r} is unknown: use some of {', '.join(sorted(_KEYS))}")
    kind = told.get("kind")
    if kind not in VERDICTS:
        raise SubmissionError(f"{where}: kind is {kind!r}: use one of {', '.join(VERDICTS)}")
    named = _named(where, told)
    if kind in ("effect", "ambiguous") and not named:
        raise SubmissionError(f"{where}: kind is {kind!r} without names: give names, or 'no_gap' or 'unknown'")
    if kind in ("no_gap", "unknown") and named:
        raise SubmissionError(f"{where}: kind is {kind!r} with names: leave names empty, or say 'effect'")
    alternatives = told.get("alternatives", [])
    if not isinstance(alternatives, list) or not all(isinstance(one, dict) for one in alternatives):
        raise SubmissionError(f"{where}: alternatives is no list of objects: write [{{names, values}}]")
    remains = told.get("remains", False)
    if not isinstance(remains, bool):
        raise SubmissionError(f"{where}: remains is {remains!r}: use true or false")
    return Answer(kind, named, tuple(_named(where, one) for one in alternatives), remains)


def _named(where: str, told: Mapping[str, Any]) -> tuple[Named, ...]:
    names, values = told.get("names", []), told.get("values", {})
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise SubmissionError(f'{where}: names is no list of words: write ["coulomb_friction@joint"]')
    if not isinstance(values, dict):
        raise SubmissionError(f'{where}: values is no object: write {{"coulomb_friction@joint": 0.1}}')
    if stray := [name for name in values if name not in names]:
        raise SubmissionError(f"{where}: a value of {stray[0]!r}, which is not in names: name it, or leave it out")
    for name, value in values.items():
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if value is not None and not (number and math.isfinite(value)):
            raise SubmissionError(f"{where}: the value of {name!r} is {value!r}: give a finite number, or null")
    named = tuple(Named.of(name, values.get(name)) for name in names)
    for one in named:
        if one.effect not in EFFECTS:
            raise SubmissionError(f"{where}: effect {one.effect!r} is unknown: use the names of docs/effects.md")
    return named


def score(answers: Mapping[str, Answer]) -> dict[str, Judged]:
    """Every case, graded; those without an answer are silent."""
    return {name: judge(case, answers.get(name)) for name, case in CASES.items()}
