"""Reading ``diagnosis.json`` back: what it holds, as a schema, and the diagnosis made of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator, ConfigDict, Field

from tiago_mj.gap.result import (
    SCHEMA,
    Closing,
    Diagnosis,
    Evidence,
    Explanation,
    Named,
    NextMotion,
    Place,
    ResidualShape,
    Shrink,
    Stopped,
    TrialModels,
    Value,
)
from tiago_mj.io.loading import load_json
from tiago_mj.io.quoting import quoted
from tiago_mj.io.schema import Open, SchemaError, checked
from tiago_mj.recordings.recording import Finding

#: Null where nothing is known; NaN in memory.
_Known = Annotated[
    float, Field(allow_inf_nan=True), BeforeValidator(lambda value: math.nan if value is None else value)
]


class _Part(Open):
    model_config = ConfigDict(extra="ignore")


class _Value(_Part):
    value: _Known
    low: float | None
    high: float | None
    unit: str
    deviation: float | None = None
    known_to: float | None = None


class _Place(_Part):
    channel: str
    phase: str
    band: str
    gap: _Known
    low: _Known
    high: _Known
    share: _Known


class _Closing(_Part):
    before: _Known
    after: _Known
    closed: float | None
    low: float | None = None
    high: float | None = None
    accounted: float | None = None


class _Evidence(_Part):
    met: _Known
    price: _Known
    misfit: _Known
    lasting: _Known
    edge: bool = False
    sharp: _Known | None = None
    agreement: _Known | None = None


class _Effect(_Part):
    name: str
    target: str | list[str]


class _Fitted(_Effect):
    parameters: dict[str, _Value]


class _Explanation(_Part):
    effects: list[_Effect]
    probability: _Known


class _Ranked(_Explanation):
    validation_gain: _Known
    parameters: dict[str, dict[str, _Value]]
    evidence: _Evidence | None = None


class _Remains(_Part):
    flag: bool
    where: list[_Place]


class _Verdict(_Part):
    kind: Literal["no_gap", "effect", "ambiguous", "unknown"]
    effects: list[_Fitted]
    probability: _Known
    alternatives: list[_Explanation]
    remains: _Remains
    not_excited: list[str]


class _Return(Open):
    """Further numbers are their ends, and the same by trial."""

    policy: str | None = None
    nominal: float | None = None
    repaired: float | None = None
    measured: float | None = None
    nominal_low: float | None = None
    nominal_high: float | None = None
    repaired_low: float | None = None
    repaired_high: float | None = None
    measured_low: float | None = None
    measured_high: float | None = None
    trials: dict[str, dict[str, float | None]] | None = None


class _Shrink(_Part):
    before: float | None
    after: float | None
    floor: _Known
    closed: float | None
    low: float | None
    high: float | None
    per_channel: dict[str, _Closing]
    task: _Return | None = Field(alias="return")
    per_phase: dict[str, _Closing] = Field(default={})
    per_place: dict[str, dict[str, _Closing]] = Field(default={}, alias="per_channel_and_phase")
    resampled: str = ""
    accounted: float | None = None
    accounted_before: float | None = None


class _ResidualShape(_Part):
    channel: str
    stages: list[str]
    carrier: str
    name: str
    share: _Known
    runner_up: str | None = None
    runner_up_share: float | None = None
    at: float | None = None
    unit: str = ""


class _Finding(_Part):
    code: str
    file: str
    channel: str
    message: str
    repaired: bool


class _NextMotion(_Part):
    file: str
    resolves: list[Annotated[list[str], Field(min_length=2, max_length=2)]]
    expected_probability: _Known


class _Splits(_Part):
    train: list[str]
    validation: list[str]
    test: list[str]


class _Stopped(_Part):
    why: Literal["budget", "interrupted", "fault"]
    seconds: float
    tried: int = 0
    effects: int = 0
    needs: float | None = None


class _TrialModels(_Part):
    simulations: int
    diverged: int
    warnings: dict[str, int]


class _Diagnosis(_Part):
    verdict: _Verdict
    where: list[_Place]
    stage: str | None
    residual_shape: _ResidualShape | None = None
    shrink: _Shrink
    ranking: list[_Ranked]
    lint: list[_Finding]
    next_motion: _NextMotion | None
    splits: _Splits
    robot: str = ""
    notes: list[str] = Field(default=[])
    complete: bool
    stopped: _Stopped | None = None
    seed: int
    version: str
    seconds: float
    physics_steps: int | None = None
    trial_models: _TrialModels | None = None


def load(path: Path) -> Diagnosis:
    """Read a diagnosis back; it has no overlays. Alternatives and the best take the rest from the ranking; without it
    their gain is NaN.

    Raises:
        ValueError: there is no such file, it is no diagnosis of this schema, or something is missing in it; one line.
    """
    if not path.is_file():
        raise ValueError(f"no diagnosis at {path}: give the diagnosis.json that tiago-mj diagnose wrote")
    data = load_json(path, f"diagnosis {path} cannot be read as JSON", mend="write it anew with tiago-mj diagnose")
    schema = data.get("schema") if isinstance(data, dict) else None
    if schema != SCHEMA:
        raise ValueError(f"diagnosis {path} has schema {quoted(schema)}: this version reads {SCHEMA!r}")
    try:
        return _diagnosis(checked(_Diagnosis, data))
    except (SchemaError, KeyError, ValueError) as fault:
        said = f"{fault.path} {fault.problem}" if isinstance(fault, SchemaError) else quoted(str(fault))
        raise ValueError(f"diagnosis {path} is incomplete: {said}; write it anew with tiago-mj diagnose") from fault


def target(effect: Named) -> str | list[str]:
    """A name, several, or ``"all"``."""
    if isinstance(effect.target, str):
        return effect.target
    return effect.target[0] if len(effect.target) == 1 else list(effect.target)


def keys(effects: Sequence[Named]) -> list[str]:
    """Of a ranking's ``parameters``: the effect's name, with its target where one effect is there twice."""
    names = [effect.name for effect in effects]
    return [
        e.name if names.count(e.name) == 1 else ":".join([e.name, *([t] if isinstance(t := target(e), str) else t)])
        for e in effects
    ]


def _diagnosis(data: _Diagnosis) -> Diagnosis:
    verdict, shrink, motion = data.verdict, data.shrink, data.next_motion
    ranking = tuple(map(_ranked, data.ranking))
    best = tuple(_named(effect, effect.parameters) for effect in verdict.effects)
    return Diagnosis(
        kind=verdict.kind,
        best=_known(best, verdict.probability, ranking),
        alternatives=tuple(_known(_plain(one), one.probability, ranking) for one in verdict.alternatives),
        remains=verdict.remains.flag,
        remains_where=_places(verdict.remains.where),
        not_excited=tuple(verdict.not_excited),
        where=_places(data.where),
        stage=data.stage,
        shrink=Shrink(
            **{
                **dict(shrink),
                "task": None if shrink.task is None else shrink.task.model_dump(exclude_unset=True),
                "per_channel": _closings(shrink.per_channel),
                "per_phase": _closings(shrink.per_phase),
                "per_place": {name: _closings(places) for name, places in shrink.per_place.items()},
            }
        ),
        ranking=ranking,
        findings=tuple(Finding(**dict(finding)) for finding in data.lint),
        next_motion=None
        if motion is None
        else NextMotion(motion.file, tuple((a, b) for a, b in motion.resolves), motion.expected_probability),
        splits={name: tuple(trials) for name, trials in data.splits},
        robot=data.robot,
        complete=data.complete,
        stopped=None if data.stopped is None else Stopped(**dict(data.stopped)),
        seed=data.seed,
        version=data.version,
        seconds=data.seconds,
        physics_steps=data.physics_steps,
        trial_models=None if data.trial_models is None else TrialModels(**dict(data.trial_models)),
        notes=tuple(data.notes),
        residual_shape=_shape(data.residual_shape),
    )


def _shape(given: _ResidualShape | None) -> ResidualShape | None:
    return None if given is None else ResidualShape(**{**dict(given), "stages": tuple(given.stages)})


def _closings(given: Mapping[str, _Closing]) -> dict[str, Closing]:
    return {name: Closing(**dict(one)) for name, one in given.items()}


def _places(rows: Sequence[_Place]) -> tuple[Place, ...]:
    return tuple(Place(**dict(row)) for row in rows)


def _named(effect: _Effect, parameters: Mapping[str, _Value]) -> Named:
    values = {key: Value(**dict(value)) for key, value in parameters.items()}
    return Named(effect.name, effect.target if isinstance(effect.target, str) else tuple(effect.target), values)


def _plain(one: _Explanation) -> tuple[Named, ...]:
    return tuple(_named(effect, {}) for effect in one.effects)


def _ranked(one: _Ranked) -> Explanation:
    names = keys(_plain(one))
    effects = tuple(_named(e, one.parameters[name]) for name, e in zip(names, one.effects, strict=True))
    evidence = None if one.evidence is None else Evidence(**dict(one.evidence))
    return Explanation(effects, one.probability, one.validation_gain, evidence)


def _known(effects: tuple[Named, ...], probability: float, ranking: tuple[Explanation, ...]) -> Explanation:
    """An explanation with what the ranking says of it."""
    same = next((r for r in ranking if _identity(r.effects) == _identity(effects)), Explanation(effects, 0.0, math.nan))
    return replace(same, probability=probability)


def _identity(effects: tuple[Named, ...]) -> list[tuple[str, str | tuple[str, ...]]]:
    return [(effect.name, effect.target) for effect in effects]
