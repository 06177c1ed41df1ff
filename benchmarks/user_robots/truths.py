"""What a case's reality has that the model lacks: nothing, dry friction, late commands, or a mass.

Every effect is written here again, differently from what a library would do at first: friction is LuGre's bristles, a
delay a queue counted in physics steps of 0.5 ms, a payload a body of its own. Nothing of ``tiago_mj.gap`` is imported.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TRUTHS: Final = ("none", "friction", "delay", "payload")
#: What the contract calls them: effect, its one parameter and its unit.
CALLED: Final = {
    "friction": ("coulomb_friction", "force"),
    "delay": ("command_delay", "seconds"),
    "payload": ("payload", "mass"),
}
#: Friction over the span of forces that the joint's actuator uses without it (its middle 95 %).
FRICTION: Final = (0.08, 0.20)
#: Delay of the commands [s].
DELAY: Final = (0.015, 0.040)
#: Travel of the bristles before they slip [m, rad].
BRISTLE: Final = 5e-4


@dataclass(frozen=True)
class Truth:
    """What a case's reality has.

    Attributes:
        kind: one of :data:`TRUTHS`.
        joint: that rubs; None otherwise.
        value: friction [N, N·m], delay [s] or mass [kg]; None for ``none``.
        facts: how it was chosen, and how clearly it shows.
    """

    kind: str
    joint: str | None = None
    value: float | None = None
    facts: dict[str, Any] = field(default_factory=dict)

    def label(self) -> dict[str, Any]:
        """As it is kept beside the answer."""
        called = CALLED.get(self.kind)
        return {
            "kind": self.kind,
            "effect": called[0] if called else None,
            "parameter": called[1] if called else None,
            "target": self.joint,
            "value": self.value,
            **self.facts,
        }


class Bristles:
    """LuGre friction of one joint: a bristle bends, and slips once it carries the friction.

    Args:
        force: when slipping [N, N·m].
        inertia: of the joint [kg, kg·m²]; bristles are made no stiffer than an explicit step can follow.
        step: physics step [s].
    """

    def __init__(self, force: float, inertia: float, step: float) -> None:
        self.stiffness = min(force / BRISTLE, (0.25 / step) ** 2 * inertia)
        self.damping = 1.2 * np.sqrt(self.stiffness * inertia)
        self.travel = force / self.stiffness
        self.step = step
        self.bend = 0.0

    def __call__(self, speed: float) -> float:
        """Force on the joint while it moves at a speed for one step."""
        rest = self.travel * np.sign(speed)
        kept = np.exp(-abs(speed) * self.step / self.travel)
        bend = rest + (self.bend - rest) * kept
        rate = (bend - self.bend) / self.step
        self.bend = float(bend)
        return -float(self.stiffness * bend + self.damping * rate)


def queued(row: int, part: int, parts: int, late: int) -> int:
    """Row whose command is in force in a physics step: ``part`` of ``parts`` of a row, sent ``late`` steps before.

    Below 0: what was in force before the first row.
    """
    return (row * parts + part - late) // parts


def draw(kind: str, rng: np.random.Generator, joints: tuple[str, ...], loads: tuple[float, float]) -> Truth:
    """A truth whose size is still relative: friction to the forces used, a payload to the tool's mass."""
    if kind == "friction":
        share = float(rng.uniform(*FRICTION))
        return Truth(kind, joint=str(rng.choice(joints)), facts={"share": share})
    if kind == "delay":
        return Truth(kind, value=float(rng.uniform(*DELAY)))
    if kind == "payload":
        return Truth(kind, facts={"share": float(rng.uniform(*loads))})
    if kind != "none":
        raise ValueError(f"truth {kind!r} is unknown: use one of {', '.join(TRUTHS)}")
    return Truth("none")
