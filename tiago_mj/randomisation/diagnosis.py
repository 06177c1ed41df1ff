"""The posterior that a ``diagnosis.json`` holds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.report import json as diagnoses
from tiago_mj.gap.result import Diagnosis, Explanation, Named, OpenNumber, Value
from tiago_mj.io.quantities import NINETY
from tiago_mj.randomisation.posterior import Block, Left, Number, Posterior, Weighed, is_factor, switch

#: Said where more is left than noise.
PART: Final = "the diagnosis explains a part of the gap only: nothing stands for the rest of it"


def is_diagnosis(path: Path) -> bool:
    """Whether a path is a diagnosis: a folder, or a file of that name."""
    return path.is_dir() or path.suffix == ".json"


def read(path: Path) -> Posterior:
    """The posterior of a diagnosis.

    Args:
        path: its folder, or its ``diagnosis.json``.

    Raises:
        ValueError: there is none, it cannot be read, or there is nothing in it to draw from; one line.
    """
    file = path / diagnoses.NAME if path.is_dir() else path
    if not file.is_file():
        raise ValueError(f"{path} holds no {diagnoses.NAME}: give the folder that tiago-mj diagnose --out wrote")
    found = diagnoses.load(file)
    return posterior(found, f"{file.resolve().parent.name}/{file.name}", diagnoses.fingerprint(file))


def posterior(found: Diagnosis, source: str, sha256: str = "") -> Posterior:
    """What a diagnosis leaves possible.

    Args:
        found: the diagnosis.
        source: what to call it.
        sha256: its fingerprint.

    Raises:
        ValueError: it has no probabilities, names nothing although there is a gap, or does not say how its magnitudes
            depend on each other; one line.
    """
    if not found.complete:
        raise ValueError(f"{source} has no probabilities, as its search was stopped: run tiago-mj diagnose to its end")
    reported = found.alternatives or (found.best,)
    if found.kind == "unknown" and not any(one.effects for one in reported):
        raise ValueError(f"{source} finds a gap and names nothing that explains it: there is no posterior to draw from")
    if not sum(one.probability for one in reported) > 0:
        raise ValueError(f"{source} gives what it reports no probability: there is no posterior to draw from")
    if any(one.joint is None for one in reported if one.effects) or (found.numbers and found.numbers_joint is None):
        raise ValueError(f"{source} holds no joint posterior of what it names: run tiago-mj diagnose again")
    return Posterior(
        source,
        sha256,
        tuple(Weighed(one.probability, _explanation(one)) for one in reported),
        _numbers(found),
        tuple(map(_left, found.open_numbers)),
        (PART,) if found.verdict.part or found.kind == "unknown" else (),
    )


def _explanation(one: Explanation) -> Block:
    """An explanation's magnitudes, and what else of its effects has an interval, such as a place."""
    if one.joint is None:
        return Block(())
    effects = tuple(effect.entry() for effect in one.effects)
    first = [
        Number(k, switch(effect.name), False, one.joint.low[k], one.joint.high[k], _unit(effect))
        for k, effect in enumerate(one.effects)
    ]
    further = [
        (Number(k, name, False, *detail.bounds, effect.parameters[name].unit), _deviation(effect.parameters[name]) ** 2)
        for k, effect in enumerate(one.effects)
        for name, detail in EFFECTS[effect.name].details.items()
        if name in effect.parameters
    ]
    whole = np.zeros((len(first) + len(further),) * 2)
    whole[: len(first), : len(first)] = one.joint.covariance
    np.fill_diagonal(whole[len(first) :, len(first) :], [variance for _, variance in further])
    return Block(effects, (*first, *(number for number, _ in further)), _rows(whole))


def _deviation(value: Value) -> float:
    """Of a number with an interval, of which one end may be at a bound."""
    if value.low is None or value.high is None:
        return 0.0
    return max(value.value - value.low, value.high - value.value) / NINETY


def _numbers(found: Diagnosis) -> Block:
    """The nominal model's numbers as fitted."""
    joint = found.numbers_joint
    if joint is None:
        return Block(())
    effects = tuple(one.effect.entry() for one in found.numbers)
    numbers = tuple(
        Number(k, one.parameter, joint.logarithms[k], joint.low[k], joint.high[k], one.unit)
        for k, one in enumerate(found.numbers)
    )
    return Block(effects, numbers, joint.covariance)


def _left(one: OpenNumber) -> Left:
    log = is_factor(one.name, one.parameter)
    effect = Named(one.name, one.target, {one.parameter: Value(one.nominal, None, None, one.unit)}).entry()
    free = Number(0, one.parameter, log, None, None, one.unit)
    sides = [abs(free.coordinate(end) - free.coordinate(one.nominal)) for end in (one.low, one.high)]
    number = Number(0, one.parameter, log, one.least, one.most, one.unit)
    return Left(Block((effect,), (number,), ((float((max(sides) / NINETY) ** 2),),)), one.left)


def _unit(effect: Named) -> str:
    return effect.parameters[switch(effect.name)].unit


def _rows(matrix: Sequence[Sequence[float]] | np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(x) for x in row) for row in matrix)
