"""What a position servo does, for effects that put something between its motor and the joint."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.now import Now

Array = NDArray[np.float64]


class Servo:
    """The servos of some simulations: force = kp · (set point - motor) - kv · motor velocity, before its limits.

    All arrays are (nsim, nactuators), in the actuators' units: joints' times gear ratio.

    Attributes:
        joints: index of each servo's joint.
        ratio: of the gear, (nactuators,).
        kp, kv: gains.
        step: physics step, (nsim, 1) [s].
    """

    def __init__(self, now: Now) -> None:
        wiring = now.wiring
        ids = wiring.actuators
        self.joints = list(wiring.targets.actuated)
        self.ratio = now.host.model.actuator_gear[ids, 0]
        bias = now.host.field("actuator_biasprm")
        self.kp, self.kv = -bias[:, ids, 1], -bias[:, ids, 2]
        self.step = now.period / now.substeps
        self._stateful = np.flatnonzero(wiring.act >= 0)

    def set_point(self, now: Now) -> Array:
        """Where the servos hold their motors."""
        wiring = now.wiring
        out = now.host.state("ctrl")[:, wiring.ctrl]
        if len(self._stateful):
            out[:, self._stateful] = now.host.state("act")[:, wiring.act[self._stateful]]
        return out

    def joint(self, now: Now) -> tuple[Array, Array]:
        """Position and velocity of the joints."""
        return now.joint_position[:, self.joints] * self.ratio, now.joint_velocity[:, self.joints] * self.ratio
