"""``calibration.yaml``: the effects and numbers that a diagnosis found, in the form that the environments load."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from tiago_mj.effects.spec import Entry
from tiago_mj.effects.written import SCHEMA
from tiago_mj.gap.report.json import clean, fingerprint
from tiago_mj.gap.result import Diagnosis, FittedNumber, Named, Value, written
from tiago_mj.io import atomic
from tiago_mj.registration import import_and_make

HEADER = """\
# Made by tiago-mj diagnose. Load it with
#   {load}
# Every value has a 90 % interval, low to high. source: the diagnosis that this is from, and the SHA-256 of what it says
# without "seconds", "physics_steps" and "trial_models", so that the same recordings and seed give the same file.
"""
#: Beside those.
NUMBERS = """\
# numbers: the model's own, fitted together with the effects and confirmed by trials to which they were not fitted. They
# are loaded with the effects; tiago_mj.effects.read_effects("calibration.yaml", numbers=False) gives the effects alone.
"""


PROVISIONAL = "# Provisional: the search did not come to its end.\n"


def text(diagnosis: Diagnosis, source: Path) -> str:
    """The file's text: the best explanation's effects, none where no gap was found.

    Args:
        diagnosis: the answer.
        source: its ``diagnosis.json``, already written; named, with its :func:`~tiago_mj.gap.report.json.fingerprint`.

    Raises:
        FileNotFoundError: there is no such file.
    """
    load, plain = import_and_make(diagnosis.robot, effects="calibration.yaml"), diagnosis.repaired
    data: dict[str, Any] = {"schema": SCHEMA, "robot": diagnosis.robot}
    if plain is not None:
        load = 'tiago_mj.gap.apply(model, "calibration.yaml"): the model is that which was diagnosed'
        data |= {
            "rate_hz": plain.rate_hz,
            "interface": plain.interface,
            "timestep": plain.timestep,
            "joints": list(plain.joints),
            "actuators": list(plain.actuators),
        }
    data |= {
        "effects": [
            *(_given(entry) for entry in diagnosis.given),
            *(_effect(effect) for effect in diagnosis.best.effects),
        ],
    }
    if diagnosis.numbers:
        data["numbers"] = [_number(one) for one in diagnosis.numbers]
    data |= {
        "source": {"file": source.name, "sha256": fingerprint(source)},
    }
    header = HEADER.format(load=load) + (NUMBERS if diagnosis.numbers else "")
    header += "" if diagnosis.complete else PROVISIONAL
    return header + yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=120)


def write(diagnosis: Diagnosis, path: Path, source: Path) -> None:
    """Write the file whole."""
    atomic.write_text(path, text(diagnosis, source))


def _effect(effect: Named) -> dict[str, Any]:
    parameters = {key: _value(value) for key, value in sorted(effect.parameters.items())}
    return {"name": effect.name, "target": written(effect.target), "parameters": parameters}


def _number(one: FittedNumber) -> dict[str, Any]:
    """A number of the nominal model as fitted, in the form of the effect that changes it."""
    value = {**clean({"value": one.value, "low": one.low, "high": one.high}), "unit": one.unit}
    parameters = {one.parameter: {**value, **clean({"nominal": one.nominal})}}
    return {"name": one.name, "target": written(one.target), "parameters": parameters}


def _given(entry: Entry) -> dict[str, Any]:
    """What was known before; it is part of the repaired simulator."""
    parameters = {name: {"value": value} for name, value in sorted(entry.parameters.items())}
    return {
        "name": entry.name,
        "target": "all" if entry.target is None else list(entry.target),
        "parameters": parameters,
    }


def _value(given: Value) -> dict[str, Any]:
    values = {"value": given.value, "low": given.low, "high": given.high}
    return {**clean(values), "unit": given.unit}
