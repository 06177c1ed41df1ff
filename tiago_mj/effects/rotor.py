"""A servo's motor of its own inertia, behind what connects it to the joint."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.actuator import let_joints_pass
from tiago_mj.effects.now import Now
from tiago_mj.effects.servo import Servo

Array = NDArray[np.float64]


#: What a connection may pass on [N, N·m]: teeth that meet push harder than the servo behind them can.
ANY_FORCE: Final = 1e9


def take_limits(now: Now, where: NDArray[np.bool_]) -> Array:
    """The servos' limits, (nsim, nactuators), which hold on the motors from now on and not on what reaches joints."""
    limits, limited = now.host.field("actuator_forcerange"), now.host.model.actuator_forcelimited
    ids = now.wiring.actuators
    out = np.where(limited[ids] != 0, limits[:, ids, 1], np.inf)
    limits[:, ids] = np.where(where[..., None], (-ANY_FORCE, ANY_FORCE), limits[:, ids])
    let_joints_pass(now, np.where(where, ANY_FORCE, np.nan))
    return out


def take_inertia(now: Now, where: NDArray[np.bool_], motor: Array) -> None:
    """Take the motors' inertia, (nsim, nactuators) [kg, kg·m²], off their joints, as far as these have one of their
    own (``armature``, which is what a model says of its motors)."""
    armature, dofs = now.host.field("dof_armature"), now.wiring.dof[list(now.wiring.targets.actuated)]
    before = armature[:, dofs]
    armature[:, dofs] = np.where(where, np.maximum(before - motor, np.minimum(before, 0.0)), before)
    now.rebuild = True


class Rotor:
    """Motors of some simulations, all arrays (nsim, nactuators) and in the actuators' units.

    The servo holds the motor; its gains and the connection are implicit on the motor's side, so that a light one does
    not ring.

    Args:
        now: at the start.
        inertia: of the motors [kg, kg·m²].
        motor: where they are at first [m, rad].
        damping: of the servos' own, on the motors.
        limit: of the servos' forces, as :func:`take_limits` gives it.
    """

    def __init__(self, now: Now, inertia: Array, motor: Array, damping: Array, limit: Array) -> None:
        self._servo, self._inertia, self._damping, self._limit = Servo(now), inertia, damping, limit
        self.position, self._speed = motor, np.zeros_like(motor)

    def passed(self, held: Array, speed: Array, beyond: Array, stiffness: Array, damping: Array) -> Array:
        """Move by a physics step; the force on the joint of a connection that is stretched so far now.

        Args:
            held: set points of the servos.
            speed: of the joints.
            beyond: what the connections are stretched by.
            stiffness, damping: of the connections.
        """
        servo, step = self._servo, self._servo.step
        wanted = servo.kp * (held - self.position) - self._damping * self._speed
        free = np.abs(wanted) < self._limit
        force = np.clip(wanted, -self._limit, self._limit)
        kp, kv = np.where(free, servo.kp, 0.0), np.where(free, self._damping, 0.0)
        beyond = beyond - step * speed  # where the joint will be
        momentum = (self._inertia + step * kv) * self._speed + step * (force - stiffness * beyond + damping * speed)
        self._speed = momentum / (self._inertia + step * (kv + damping) + step * step * (kp + stiffness))
        self.position = self.position + step * self._speed
        return stiffness * (beyond + step * self._speed) + damping * (self._speed - speed)
