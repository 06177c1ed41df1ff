"""The fastest that a joint moves."""

from __future__ import annotations

from typing import Final

import numpy as np

from tiago_mj.effects.actuator import limit_forces
from tiago_mj.effects.declare import Array, Effect, effect
from tiago_mj.effects.fields import parameter
from tiago_mj.effects.inertia import inertia_at
from tiago_mj.effects.now import Now

SPEED = ("m/s", "rad/s")

#: Shares of what a new estimate of the load is off by that go into the running one and, while the limit holds, into how
#: fast it grows. Pressed into an object, the load grows by some 100 N/s: without the second share a joint at its limit
#: fell back to half of it. In a start at full force the limit is exceeded by 4 %, for some milliseconds.
LOAD_UPDATE: Final = 0.4
RISE_UPDATE: Final = 0.1


@effect("velocity_limit", stage="transmission", targets="joint")
class VelocityLimit(Effect):
    """The joint moves no faster than a limit, whatever is commanded.

    Formula: |velocity| ≤ limit: each physics step the servo's force is bounded by the one that would reach it

    In a recording: fast commands are followed at a constant lower speed while the servo's error grows.

    Typical: 0.5-0.9 of the nominal: the fingers' URDF says 0.05 m/s, their simulation 0.08 m/s.

    On the robot: look at the speed limit set in the driver, and at the supply's voltage.

    Source: pal_gripper; the share is chosen.
    """

    clause = "{t} move{s} no faster than {velocity}"

    velocity = parameter(SPEED, identity=np.inf, default=0.5, bounds=(0.05, 1.0), nominal="velocity")

    def change(self, now: Now) -> None:
        unlimited = np.full_like(self.velocity, np.inf)[:, list(now.wiring.targets.actuated)]
        limit_forces(now, self.present[:, list(now.wiring.targets.actuated)], unlimited)

    def start(self, now: Now) -> None:
        joints, dofs = list(now.wiring.targets.actuated), now.wiring.dof[list(now.wiring.targets.actuated)]
        self._step = now.period / now.substeps
        # Joint damping is integrated implicitly: it acts as a further inertia within a step.
        self._mass = inertia_at(now)[:, joints] + self._step * now.host.field("dof_damping")[:, dofs]
        self._servo = -self._step * now.host.field("actuator_biasprm")[:, now.wiring.actuators, 2]
        self._limit = self.velocity[:, joints]
        self._speed = now.joint_velocity[:, joints]
        self._load, self._rise = np.zeros_like(self._speed), np.zeros_like(self._speed)
        self._range = now.host.field("actuator_forcerange")[:, now.wiring.actuators].copy()

    def force_range(self, limits: Array, now: Now) -> Array:
        speed = now.joint_velocity[:, list(now.wiring.targets.actuated)]
        force = now.host.output("actuator_force")[:, now.wiring.actuators]
        # The servo's own damping is implicit, too, while its force is below the limits.
        free = (force > self._range[..., 0]) & (force < self._range[..., 1])
        load = force - (self._mass + np.where(free, self._servo, 0.0)) * (speed - self._speed) / self._step
        foreseen = self._load + self._rise
        self._load = foreseen + LOAD_UPDATE * (load - foreseen)
        self._rise = np.where(free, 0.0, self._rise + RISE_UPDATE * (load - foreseen))
        self._speed = speed
        fastest = self._limit[..., None] * (-1.0, 1.0)
        load = self._load + self._rise
        reaching = load[..., None] + (self._mass / self._step)[..., None] * (fastest - speed[..., None])
        self._range = np.clip(reaching, limits[..., :1], limits[..., 1:])
        return self._range
