"""``calibration.yaml``: the effects that a diagnosis found, in the form that the environments load."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from tiago_mj import atomic
from tiago_mj.gap.effects.spec import SCHEMA
from tiago_mj.gap.report.json import clean, fingerprint, target
from tiago_mj.gap.result import Diagnosis, Named, Value

HEADER = """\
# Made by tiago-mj diagnose. Load it with gymnasium.make(ID, effects="calibration.yaml").
# Every value has a 90 % interval, low to high. source: the diagnosis that this is from, and the SHA-256 of what it says
# without "seconds", so that the same recordings and seed give the same file.
"""


def text(diagnosis: Diagnosis, source: Path) -> str:
    """The file's text: the best explanation's effects, none where no gap was found.

    Args:
        diagnosis: the answer.
        source: its ``diagnosis.json``, already written; named, with its :func:`~tiago_mj.gap.report.json.fingerprint`.

    Raises:
        FileNotFoundError: there is no such file.
    """
    data = {
        "schema": SCHEMA,
        "robot": diagnosis.robot,
        "effects": [_effect(effect) for effect in diagnosis.best.effects],
        "source": {"file": source.name, "sha256": fingerprint(source)},
    }
    return HEADER + yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=120)


def write(diagnosis: Diagnosis, path: Path, source: Path) -> None:
    """Write the file whole."""
    atomic.write_text(path, text(diagnosis, source))


def _effect(effect: Named) -> dict[str, Any]:
    parameters = {key: _value(value) for key, value in sorted(effect.parameters.items())}
    return {"name": effect.name, "target": target(effect), "parameters": parameters}


def _value(given: Value) -> dict[str, Any]:
    values = {"value": given.value, "low": given.low, "high": given.high}
    return {**clean(values), "unit": given.unit}
