"""Masses and gravity."""

from __future__ import annotations

import numpy as np

from tiago_mj.gap.effects.declare import Effect, effect, parameter
from tiago_mj.gap.effects.now import Now


@effect("payload", stage="body", targets="joint")
class Payload(Effect):
    """Unmodelled mass at the tool, of which the robot's gravity compensation knows nothing.

    The mass sits at the tool body's centre of mass; what a body weighs is never below 0.

    Formula: joint torque += mass · g · lever arm; inertia += mass · lever arm²

    In a recording: joint torques and sagging that follow gravity over the pose; larger torques in fast motion.

    Typical: 0.1-2 kg: a camera, a cable, an adapter.

    Source: chosen.

    MuJoCo: ``body_mass``, ``body_gravcomp``.
    """

    mass = parameter("kg", identity=0.0, default=0.5, bounds=(-1.0, 5.0))

    def change(self, now: Now) -> None:
        tool, mass = now.wiring.tool, self.mass.sum(axis=1)
        body_mass, compensation = now.host.field("body_mass"), now.host.field("body_gravcomp")
        before = body_mass[:, tool].copy()
        after = np.maximum(before + mass, 1e-6)
        has = mass != 0
        # The compensation lifts the nominal mass, not the new one.
        compensation[has, tool] *= before[has] / after[has]
        body_mass[:, tool] = np.where(has, after, before)
        now.rebuild = True


@effect("gravity_tilt", stage="body", targets="object")
class GravityTilt(Effect):
    """Base or table are tilted about the grasp axis.

    Gravity turns by the angle in the model's frame. The robot's own gravity compensation turns with it, so that it is
    the object, and what is not compensated, that feels it.

    Formula: gravity = g · (cos(angle) down + sin(angle) across the grasp axis)

    In a recording: a free object drifts or leans; under load across the pads it slips sooner.

    Typical: below 0.05 rad.

    Source: chosen.

    MuJoCo: ``opt.gravity``.
    """

    angle = parameter("rad", identity=0.0, default=0.1, bounds=(-0.5, 0.5))

    def change(self, now: Now) -> None:
        gravity, axis = now.host.field("opt.gravity"), now.wiring.grasp_axis
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        along = (gravity @ axis)[:, None] * axis
        tilted = along + cosine * (gravity - along) + sine * np.cross(axis, gravity)  # Rodrigues
        gravity[:] = np.where(self.present, tilted, gravity)
