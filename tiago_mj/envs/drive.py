"""What an action makes of the servos' inputs: array functions over leading axes, for one simulation and for many."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.envs.state import Span, span

Array = NDArray[np.float64]

CONTROLS: Final = ("velocity", "position")


@dataclass(frozen=True)
class Drive:
    """The commanded joints' servos, and the way from an action to their inputs.

    A set point is what a servo pulls its joint to; it is the state of its actuator, and its input is the speed at which
    the set point moves.

    Attributes:
        control: ``velocity``: an action in [-1, 1] is a velocity over the joint's limit; ``position``: a target over
            its range.
        ideal: whether set points are kept from running away from the joints (``servo="ideal"``).
        period: control period [s].
        velocity_limit, low, high: of the joints, (N,) [m/s, rad/s], [m, rad].
        slack: how far an ideal servo's set point may lead before its effort limit holds it, (N,) [m, rad].
        lag: of an ideal servo, damping over stiffness, (N,) [s].
        held: columns of joints that stay where they are, whatever the action says of them.
        inputs, position, velocity: where ``ctrl`` and ``act``, ``qpos``, and ``qvel`` have the joints.
    """

    control: str
    ideal: bool
    period: float
    velocity_limit: Array
    low: Array
    high: Array
    slack: Array
    lag: Array
    held: tuple[int, ...]
    inputs: Span
    position: Span
    velocity: Span

    @classmethod
    def of(
        cls, model: mujoco.MjModel, joints: tuple[str, ...], *, control: str, ideal: bool, period: float, held: bool
    ) -> Drive:
        """Find the joints and their servos in a model.

        Args:
            model: a scene of :mod:`tiago_mj.models.scene`.
            joints: what is commanded; every one has an actuator of its name.
            control, ideal, period: see the class.
            held: whether the last two joints, the fingers, are held.
        """
        ids = [model.actuator(name).id for name in joints]
        limits = np.array([model.joint(name).range for name in joints])
        stiffness = model.actuator_gainprm[ids, 0]
        return cls(
            control=control,
            ideal=ideal,
            period=period,
            velocity_limit=np.array(model.actuator_ctrlrange[ids, 1]),
            low=limits[:, 0],
            high=limits[:, 1],
            slack=model.actuator_forcerange[ids, 1] / stiffness,
            lag=-model.actuator_biasprm[ids, 2] / stiffness,
            held=tuple(range(len(joints))[-2:]) if held else (),
            inputs=span(ids),
            position=span([int(model.joint(name).qposadr[0]) for name in joints]),
            velocity=span([int(model.joint(name).dofadr[0]) for name in joints]),
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

    def apply(self, command: Array, ctrl: Array, act: Array, qpos: Array, qvel: Array) -> None:
        """Write the servos' inputs, and an ideal servo's set points, for one control period.

        Args:
            command: (..., N), of :meth:`command`.
            ctrl, act: of the simulations, (..., nu) and (..., na); written.
            qpos, qvel: of the simulations, (..., nq) and (..., nv); read.
        """
        speed = command
        if self.ideal or self.control == "position":
            point = act[..., self.inputs]
            if self.ideal:
                # A velocity servo has no set point to run away: what the effort limit cannot hold is forgotten.
                # kp (set point − q) − kv q̇ within ± the limit.
                joint = qpos[..., self.position] + self.lag * qvel[..., self.velocity]
                point = np.minimum(np.maximum(point, joint - self.slack), joint + self.slack)
                act[..., self.inputs] = point
            if self.control == "position":
                speed = (command - point) / self.period
                speed = np.minimum(np.maximum(speed, -self.velocity_limit), self.velocity_limit)
        ctrl[..., self.inputs] = speed
