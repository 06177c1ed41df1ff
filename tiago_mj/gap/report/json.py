"""A diagnosis as ``diagnosis.json`` (schema ``tiago_mj.diagnosis/1``), and back.

Floats have six significant digits, keys a fixed order: equal diagnoses are equal files, but for ``seconds``. What is
unknown is null.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

from tiago_mj import atomic
from tiago_mj.gap.data.recording import Finding
from tiago_mj.gap.result import (
    PHASES,
    SCHEMA,
    Closing,
    Diagnosis,
    Evidence,
    Explanation,
    Named,
    NextMotion,
    Place,
    Shrink,
    Value,
)

DIGITS = 6
SPLITS = ("train", "validation", "test")
TASK = ("policy", "nominal", "repaired", "measured")


def as_data(diagnosis: Diagnosis) -> dict[str, Any]:
    """What the file holds; only dicts, lists, strings, finite numbers, booleans and None."""
    shrink = diagnosis.shrink
    data = {
        "schema": SCHEMA,
        "verdict": {
            "kind": diagnosis.kind,
            "effects": [{**_effect(e), "parameters": _parameters(e)} for e in diagnosis.best.effects],
            "probability": diagnosis.best.probability,
            "alternatives": [
                {"effects": [_effect(e) for e in one.effects], "probability": one.probability}
                for one in diagnosis.alternatives
            ],
            "remains": {"flag": diagnosis.remains, "where": [_place(place) for place in diagnosis.remains_where]},
            "not_excited": list(diagnosis.not_excited),
        },
        "where": [_place(place) for place in diagnosis.where],
        "stage": diagnosis.stage,
        "shrink": {
            **{key: getattr(shrink, key) for key in ("before", "after", "floor", "closed", "low", "high")},
            "per_channel": _closings(shrink.per_channel),
            "return": None if shrink.task is None else {**dict.fromkeys(TASK), **shrink.task},
            "per_phase": {name: _closing(shrink.per_phase[name]) for name in _in_order(shrink.per_phase)},
            "per_channel_and_phase": {
                name: {phase: _closing(places[phase]) for phase in _in_order(places)}
                for name, places in sorted(shrink.per_place.items())
            },
            "resampled": shrink.resampled,
            "accounted": shrink.accounted,
        },
        "ranking": [
            {
                "effects": [_effect(e) for e in one.effects],
                "validation_gain": one.validation_gain,
                "probability": one.probability,
                "parameters": {key: _parameters(e) for key, e in zip(_keys(one.effects), one.effects, strict=True)},
                "evidence": None if one.evidence is None else asdict(one.evidence),
            }
            for one in diagnosis.ranking
        ],
        "lint": [
            {"code": f.code, "file": f.file, "channel": f.channel, "message": f.message, "repaired": f.repaired}
            for f in diagnosis.findings
        ],
        "next_motion": _next_motion(diagnosis.next_motion),
        "splits": {name: list(diagnosis.splits.get(name, ())) for name in SPLITS},
        "robot": diagnosis.robot,
        "notes": list(diagnosis.notes),
        "complete": diagnosis.complete,
        "seed": diagnosis.seed,
        "version": diagnosis.version,
        "seconds": diagnosis.seconds,
    }
    cleaned: dict[str, Any] = clean(data)
    return cleaned


def text(diagnosis: Diagnosis) -> str:
    """The file's text."""
    return json.dumps(as_data(diagnosis), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def write(diagnosis: Diagnosis, path: Path) -> None:
    """Write the file whole."""
    atomic.write_text(path, text(diagnosis))


def fingerprint(path: Path) -> str:
    """SHA-256 of what a diagnosis says, without ``seconds``: the same recordings and seed have the same.

    It is taken of the JSON without that key, with sorted keys and no white space (ASCII).

    Raises:
        FileNotFoundError: there is no such file.
    """
    data = json.loads(path.read_text(encoding="utf-8"))
    data.pop("seconds", None)
    return hashlib.sha256(json.dumps(data, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def load(path: Path) -> Diagnosis:
    """Read a diagnosis back; it has no overlays. Alternatives and the best take the rest from the ranking; without it
    their gain is NaN.

    Raises:
        ValueError: there is no such file, it is no diagnosis of this schema, or something is missing in it; one line.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as fault:
        raise ValueError(f"no diagnosis at {path}: give the diagnosis.json that tiago-mj diagnose wrote") from fault
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as fault:
        raise ValueError(f"diagnosis {path} cannot be read as JSON: {' '.join(str(fault).split())}") from fault
    schema = data.get("schema") if isinstance(data, dict) else None
    if schema != SCHEMA:
        raise ValueError(f"diagnosis {path} has schema {schema!r}: this version reads {SCHEMA!r}")
    try:
        return _diagnosis(data)
    except (KeyError, TypeError, AttributeError, ValueError) as fault:
        raise ValueError(f"diagnosis {path} is incomplete: {fault!r}; write it anew with tiago-mj diagnose") from fault


def clean(value: Any) -> Any:
    """Plain JSON values: numbers finite and rounded, NumPy's turned into Python's."""
    if isinstance(value, Mapping):
        return {str(key): clean(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [clean(item) for item in value]
    if hasattr(value, "item"):  # a NumPy scalar
        value = value.item()
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") + 0.0 if math.isfinite(value) else None
    return value


def target(effect: Named) -> str | list[str]:
    """A name, several, or ``"all"``."""
    if isinstance(effect.target, str):
        return effect.target
    return effect.target[0] if len(effect.target) == 1 else list(effect.target)


def _effect(effect: Named) -> dict[str, Any]:
    return {"name": effect.name, "target": target(effect)}


def _parameters(effect: Named) -> dict[str, Any]:
    return {key: {f.name: getattr(v, f.name) for f in fields(v)} for key, v in sorted(effect.parameters.items())}


def _keys(effects: Sequence[Named]) -> list[str]:
    """Of a ranking's ``parameters``: the effect's name, with its target where one effect is there twice."""
    names = [effect.name for effect in effects]
    return [
        e.name if names.count(e.name) == 1 else ":".join([e.name, *([t] if isinstance(t := target(e), str) else t)])
        for e in effects
    ]


def _closing(c: Closing) -> dict[str, Any]:
    return {key: getattr(c, key) for key in ("before", "after", "closed", "low", "high")}


def _closings(given: Mapping[str, Closing]) -> dict[str, Any]:
    return {name: _closing(c) for name, c in sorted(given.items())}


def _in_order(phases: Mapping[str, Closing]) -> list[str]:
    return [name for name in PHASES if name in phases]


def _place(place: Place) -> dict[str, Any]:
    return {key: getattr(place, key) for key in ("channel", "phase", "band", "gap", "low", "high", "share")}


def _next_motion(motion: NextMotion | None) -> dict[str, Any] | None:
    if motion is None:
        return None
    return {
        "file": motion.file,
        "resolves": [list(pair) for pair in motion.resolves],
        "expected_probability": motion.expected_probability,
    }


def _diagnosis(data: Mapping[str, Any]) -> Diagnosis:
    verdict, shrink, motion = data["verdict"], data["shrink"], data["next_motion"]
    ranking = tuple(_ranked(one) for one in data["ranking"])
    best = _known(tuple(_named(e, e["parameters"]) for e in verdict["effects"]), verdict["probability"], ranking)
    return Diagnosis(
        kind=verdict["kind"],
        best=best,
        alternatives=tuple(_alternative(one, ranking) for one in verdict["alternatives"]),
        remains=verdict["remains"]["flag"],
        remains_where=_places(verdict["remains"]["where"]),
        not_excited=tuple(verdict["not_excited"]),
        where=_places(data["where"]),
        stage=data["stage"],
        shrink=Shrink(
            **{key: shrink[key] for key in ("before", "after", "floor", "closed", "low", "high")},
            per_channel=_read_closings(shrink["per_channel"]),
            task=shrink["return"],
            per_phase=_read_closings(shrink.get("per_phase", {})),
            per_place={
                name: _read_closings(places) for name, places in shrink.get("per_channel_and_phase", {}).items()
            },
            resampled=shrink.get("resampled", ""),
            accounted=_number(shrink.get("accounted")),
        ),
        ranking=ranking,
        findings=tuple(Finding(**finding) for finding in data["lint"]),
        next_motion=None
        if motion is None
        else NextMotion(
            motion["file"],
            tuple((first, second) for first, second in motion["resolves"]),
            _number(motion["expected_probability"]),
        ),
        splits={name: tuple(data["splits"][name]) for name in SPLITS},
        robot=data.get("robot", ""),
        complete=data["complete"],
        seed=data["seed"],
        version=data["version"],
        seconds=data["seconds"],
        notes=tuple(data.get("notes", ())),
    )


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _read_closings(given: Mapping[str, Mapping[str, Any]]) -> dict[str, Closing]:
    return {
        name: Closing(_number(c["before"]), _number(c["after"]), c["closed"], c.get("low"), c.get("high"))
        for name, c in given.items()
    }


def _named(effect: Mapping[str, Any], parameters: Mapping[str, Any]) -> Named:
    whom = effect["target"]
    values = {
        key: Value(_number(p["value"]), p["low"], p["high"], p["unit"], p.get("deviation"), p.get("known_to"))
        for key, p in parameters.items()
    }
    return Named(effect["name"], whom if isinstance(whom, str) else tuple(whom), values)


def _ranked(one: Mapping[str, Any]) -> Explanation:
    keys = _keys([_named(e, {}) for e in one["effects"]])
    effects = tuple(_named(e, one["parameters"][key]) for key, e in zip(keys, one["effects"], strict=True))
    given = one.get("evidence")
    evidence = None
    if given is not None:
        met, price, misfit, lasting = (_number(given[key]) for key in ("met", "price", "misfit", "lasting"))
        evidence = Evidence(met, price, misfit, lasting, bool(given.get("edge", False)))
    return Explanation(effects, _number(one["probability"]), _number(one["validation_gain"]), evidence)


def _alternative(one: Mapping[str, Any], ranking: tuple[Explanation, ...]) -> Explanation:
    return _known(tuple(_named(e, {}) for e in one["effects"]), one["probability"], ranking)


def _known(effects: tuple[Named, ...], probability: float | None, ranking: tuple[Explanation, ...]) -> Explanation:
    """An explanation with what the ranking says of it."""
    same = next((r for r in ranking if _identity(r.effects) == _identity(effects)), Explanation(effects, 0.0, math.nan))
    return replace(same, probability=_number(probability))


def _identity(effects: tuple[Named, ...]) -> list[tuple[str, str | tuple[str, ...]]]:
    return [(effect.name, effect.target) for effect in effects]


def _places(rows: Sequence[Mapping[str, Any]]) -> tuple[Place, ...]:
    return tuple(
        Place(
            row["channel"], row["phase"], row["band"], *(_number(row[key]) for key in ("gap", "low", "high", "share"))
        )
        for row in rows
    )
