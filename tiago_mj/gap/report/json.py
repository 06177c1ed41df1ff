"""A diagnosis as ``diagnosis.json`` (schema ``tiago_mj.diagnosis/1``), and back (:mod:`~.read`).

Floats have six significant digits, keys a fixed order: equal diagnoses are equal files, but for what they took
(:data:`EFFORT`). What is unknown is null.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from tiago_mj.gap.report.read import keys, load, target
from tiago_mj.gap.result import PHASES, SCHEMA, Closing, Diagnosis, Named, NextMotion, Place
from tiago_mj.io import atomic

__all__ = ["as_data", "clean", "fingerprint", "load", "target", "text", "write"]

DIGITS = 6
SPLITS = ("train", "validation", "test")
#: What a diagnosis took, which is no part of what it says.
EFFORT = ("seconds", "physics_steps", "trial_models")
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
        "residual_shape": None if diagnosis.residual_shape is None else asdict(diagnosis.residual_shape),
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
            "accounted_before": shrink.accounted_before,
        },
        "ranking": [
            {
                "effects": [_effect(e) for e in one.effects],
                "validation_gain": one.validation_gain,
                "probability": one.probability,
                "parameters": {key: _parameters(e) for key, e in zip(keys(one.effects), one.effects, strict=True)},
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
        "stopped": None if diagnosis.stopped is None else asdict(diagnosis.stopped),
        "seed": diagnosis.seed,
        "version": diagnosis.version,
        "seconds": diagnosis.seconds,
        "physics_steps": diagnosis.physics_steps,
        "trial_models": None if diagnosis.trial_models is None else asdict(diagnosis.trial_models),
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
    """SHA-256 of what a diagnosis says, without what it took: the same recordings and seed have the same.

    It is taken of the JSON without :data:`EFFORT`, with sorted keys and no white space (ASCII).

    Raises:
        FileNotFoundError: there is no such file.
    """
    data = json.loads(path.read_text(encoding="utf-8"))
    for effort in EFFORT:
        data.pop(effort, None)
    return hashlib.sha256(json.dumps(data, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


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


def _effect(effect: Named) -> dict[str, Any]:
    return {"name": effect.name, "target": target(effect)}


def _parameters(effect: Named) -> dict[str, Any]:
    return {key: {f.name: getattr(v, f.name) for f in fields(v)} for key, v in sorted(effect.parameters.items())}


def _closing(c: Closing) -> dict[str, Any]:
    return {key: getattr(c, key) for key in ("before", "after", "closed", "low", "high", "accounted")}


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
