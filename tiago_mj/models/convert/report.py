"""Report of a conversion: what was repaired, fitted, excluded, added and dropped."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import mujoco

from tiago_mj.models.convert.inertia import InertiaRepair


@dataclass(frozen=True)
class FittedShape:
    """A primitive for a mesh: RMS distance of the mesh's hull from its surface, its volume over the hull's."""

    link: str
    mesh: str
    kind: str
    rms_distance: float  # m
    volume_ratio: float

    def __str__(self) -> str:
        quality = f"{1000 * self.rms_distance:.1f} mm RMS off the hull, volume x {self.volume_ratio:.2f}"
        return f"link {self.link}: {self.mesh} -> {self.kind} ({quality})"


@dataclass(frozen=True)
class ConversionReport:
    """The model and what was changed on the way; ``spec`` is ready to compile or to attach to a scene."""

    robot: str
    out: Path | None
    repaired: tuple[InertiaRepair, ...]
    fitted: tuple[FittedShape, ...]
    excluded: tuple[tuple[str, str], ...]
    dropped: tuple[str, ...]
    added: tuple[str, ...]
    xml: str = field(repr=False)
    spec: mujoco.MjSpec = field(repr=False, compare=False)

    def lines(self) -> list[str]:
        """The report as text, one fact per line."""
        facts = [f"repaired  {repair}" for repair in self.repaired]
        facts += [f"fitted    {fit}" for fit in self.fitted]
        facts += [f"excluded  contacts between {a} and {b}" for a, b in self.excluded]
        facts += [f"added     {what}" for what in self.added]
        facts += [f"dropped   {what}" for what in self.dropped]
        return facts
