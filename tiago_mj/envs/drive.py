"""What an action commands: array functions over leading axes, for one simulation and for many."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.host import Span, span

Array = NDArray[np.float64]

CONTROLS: Final = ("velocity", "position")


@dataclass(frozen=True)
class Drive:
    """The commanded joints' limits, and the way from an action to a command.

    Attributes:
        control: ``velocity``: an action in [-1, 1] is a velocity over the joint's limit; ``position``: a target over
            its range.
        velocity_limit, low, high: of the joints, (N,) [m/s, rad/s], [m, rad].
        held: columns of joints that stay where they are, whatever the action says of them.
        inputs: where ``ctrl`` and ``act`` have the joints.
    """

    control: str
    velocity_limit: Array
    low: Array
    high: Array
    held: tuple[int, ...]
    inputs: Span

    @classmethod
    def of(cls, model: mujoco.MjModel, joints: tuple[str, ...], *, control: str, held: bool) -> Drive:
        """Find the joints and their servos in a model.

        Args:
            model: a scene of :mod:`tiago_mj.models.scene`.
            joints: what is commanded; every one has an actuator of its name.
            control: see the class.
            held: whether the last two joints, the fingers, are held.
        """
        ids = [model.actuator(name).id for name in joints]
        limits = np.array([model.joint(name).range for name in joints])
        return cls(
            control=control,
            velocity_limit=np.array(model.actuator_ctrlrange[ids, 1]),
            low=limits[:, 0],
            high=limits[:, 1],
            held=tuple(range(len(joints))[-2:]) if held else (),
            inputs=span(ids),
        )

    def command(self, action: Array, act: Array) -> Array:
        """What actions command: velocities [m/s, rad/s] or, with position control, targets [m, rad].

        Args:
            action: (..., N) in [-1, 1].
            act: the servos' set points as the simulation holds them, (..., na).
        """
        if self.control == "velocity":
            command = action * self.velocity_limit
        else:
            command = self.low + (action + 1) / 2 * (self.high - self.low)
        if self.held:
            held = list(self.held)
            command[..., held] = self.idle(act)[..., held]
        return command

    def idle(self, act: Array) -> Array:
        """The command that leaves every set point where it is, (..., N)."""
        points: Array = np.array(act[..., self.inputs])
        return points if self.control == "position" else np.zeros_like(points)
