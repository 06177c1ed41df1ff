"""Nuisance properties of a robot and its session, drawn independently of the effect: converters with few bits, small
motions.

A converter of few bits is no effect where the data sheet states it: the sidecars say its step. A session that moves a
joint little in most recordings and far in the others is how somebody recorded, and nothing is said of it. Facts are
drawn apart from everything else, so that a case differs from one without them in nothing but these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.effects.sensors import Converter
from benchmarks.blind.robots import UNITS_PER_NEWTON, Robot
from tiago_mj.models import names

Array = NDArray[np.float64]

#: Shares of cases with coarse load cells, with coarse encoders, and, of arms and hinges, with joints that move little
#: in most recordings: chosen, so that three in ten cases have one.
CELLS: Final = 0.15
ENCODERS: Final = 0.15
NARROW: Final = 0.2
#: Bits of converters: of load cells' amplifiers, and of encoders over a turn, or over the travel of what slides.
CELL_BITS: Final = (8, 10)
ENCODER_BITS: Final = (8, 14)
#: Largest force of a finger's servo [N], and a load cell's range over it: what holds it just so, to a cell of 130 N.
FINGER_FORCE: Final = 16.0
RANGE: Final = (1.1, 8.0)
#: Share of converters whose output still passes noise, as of one whose signal is averaged or sent on.
BEFORE: Final = 0.3
#: How far joints move in most recordings, over how far they move in the others.
NARROWED: Final = (0.15, 0.35)


@dataclass(frozen=True)
class Grid:
    """A converter.

    Attributes:
        kind: ``force`` or ``position``: of both load cells, or of every encoder.
        bits: of one.
        span: what they divide, of load cells [sensor units]; of encoders it is the joint's own.
        before: whether noise comes after rounding, so that readings lie on no grid.
    """

    kind: str
    bits: int
    span: float = 0.0
    before: bool = False

    def steps(self, robot: Robot) -> Array:
        """Of each load cell, (2,), or encoder, (n,)."""
        if self.kind == "force":
            return np.full(2, self.span / 2**self.bits)
        slides = np.isin(robot.joints, (*names.FINGERS, *names.TORSO))
        return np.where(slides, robot.high - robot.low, 2 * np.pi) / 2**self.bits


def draw(seed: Sequence[int], *, cells: bool, rounded: frozenset[str], gripper: bool) -> tuple[tuple[Grid, ...], float]:
    """Converters of a case, and how far joints move in most recordings over how far they do in the others.

    Args:
        seed: of this case's facts.
        cells: whether there are load cells.
        rounded: kinds of readings that an effect of the case rounds: of these nothing is stated.
        gripper: whether the fingers move, whose sessions all press.
    """
    rng = np.random.default_rng(list(seed))
    chances, befores = rng.random(3), rng.random(2)
    bits = rng.choice(CELL_BITS), rng.integers(*ENCODER_BITS, endpoint=True)
    span = FINGER_FORCE * UNITS_PER_NEWTON * float(np.exp(rng.uniform(*np.log(RANGE))))
    narrow = float(np.round(rng.uniform(*NARROWED), 3))
    out = []
    if cells and chances[0] < CELLS and "force" not in rounded:
        out.append(Grid("force", int(bits[0]), float(f"{span:.4g}"), bool(befores[0] < BEFORE)))
    if chances[1] < ENCODERS and "position" not in rounded:
        out.append(Grid("position", int(bits[1]), before=bool(befores[1] < BEFORE)))
    return tuple(out), narrow if not gripper and chances[2] < NARROW else 1.0


def converters(grids: Sequence[Grid], robot: Robot) -> list[Converter]:
    """Ready to run."""
    return [Converter(grid.kind, grid.steps(robot), grid.before) for grid in grids]


def stated(grids: Sequence[Grid], robot: Robot) -> dict[str, Any]:
    """What a data sheet says: steps by kind, or by column where they differ."""
    out: dict[str, Any] = {}
    for grid in grids:
        steps = [float(f"{step:.6g}") for step in grid.steps(robot)]
        if len(set(steps)) == 1:
            out[grid.kind] = steps[0]
        else:
            out.update({f"{grid.kind}.{joint}": step for joint, step in zip(robot.joints, steps, strict=True)})
    return out
