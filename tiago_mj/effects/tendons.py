"""Fixed tendons, by which a model file has what an effect does to several joints at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco


@dataclass(frozen=True)
class Tendon:
    """A fixed tendon.

    Attributes:
        name: of the element.
        turns: joints and how far the tendon moves with each [–].
        numbers: attributes of the element by their names in ``mjSpec``.
    """

    name: str
    turns: tuple[tuple[str, float], ...]
    numbers: tuple[tuple[str, tuple[float, ...]], ...]


def add(spec: mujoco.MjSpec, tendons: Sequence[Tendon]) -> None:
    """Give a model tendons that it does not have yet."""
    for one in tendons:
        element = spec.add_tendon(name=one.name)
        for joint, coefficient in one.turns:
            element.wrap_joint(joint, coefficient)
        for name, values in one.numbers:
            present: Any = getattr(element, name)
            if hasattr(present, "__len__"):
                present[: len(values)] = values
            else:
                setattr(element, name, values[0])
