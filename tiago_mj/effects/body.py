"""Masses and gravity."""

from __future__ import annotations

from typing import ClassVar, Final

import mujoco
import numpy as np

from tiago_mj.effects.declare import Array, Effect, effect
from tiago_mj.effects.fields import detail, known_to, parameter
from tiago_mj.effects.now import Now, Wiring

#: How far from the tool's centre of mass a payload is sought [m].
REACH: Final = 0.5


def principal(quaternion: Array, inertia: Array, mass: float, arm: Array) -> tuple[Array, Array]:
    """Principal axes and moments of a body beside which there is another mass.

    Args:
        quaternion, inertia: of the body, (4,), (3,) [kg·m²].
        mass: reduced mass of both [kg]; negative where mass was taken away.
        arm: from the one centre to the other, (3,) [m].

    Returns:
        Quaternion and moments about the common centre, which some body could have: what is taken from a body is
        never more than it has there.
    """
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    turn = matrix.reshape(3, 3)
    # Of second moments of mass none can be negative, whatever the axis; that is all that a body's inertia has to obey.
    second = turn @ np.diag(inertia.sum() / 2 - inertia) @ turn.T + mass * np.outer(arm, arm)
    moments, axes = np.linalg.eigh(second)
    if mass < 0:
        moments = np.maximum(moments, 0.0)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    turned = np.zeros(4)
    mujoco.mju_mat2Quat(turned, axes.ravel())
    return turned, moments.sum() - moments


@effect("payload", stage="body", targets="joint")
class Payload(Effect):
    """Unmodelled mass at the tool, which the robot's gravity compensation does not lift.

    The mass is a point at x, y, z from the tool body's centre of mass, along the body's axes; at that centre where no
    place is given. What a body weighs is never below 0. Gravity compensation lifts the nominal mass at the common
    centre.

    Formula: joint torque += mass · g · lever arm; inertia += mass · lever arm²

    In a recording: joint torques and sagging that follow gravity over the pose; larger torques in fast motion.

    Typical: 0.1-2 kg: a camera, a cable, an adapter.

    On the robot: weigh what the arm carries, with tool, cables and adapters.

    Source: chosen.

    MuJoCo: ``body_mass``, ``body_gravcomp``; of a place ``body_ipos``, ``body_iquat``, ``body_inertia``.
    """

    subject = "the tool"
    clause = "{t} carries {mass} that the simulator lacks"
    clause_less = "{t} carries {mass} less than in the simulator"
    nominal_prior = known_to(0.04, share_of="stock")
    common = True
    takes_from = "tool_mass"

    mass = parameter("kg", identity=0.0, default=0.5, bounds=(-1.0, 5.0))
    x = detail("m", (-REACH, REACH))
    y = detail("m", (-REACH, REACH))
    z = detail("m", (-REACH, REACH))

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
        place = self._place()
        beside = has & place.any(axis=1)
        if not beside.any():
            return
        centre, axes, inertia = (now.host.field(name) for name in ("body_ipos", "body_iquat", "body_inertia"))
        for sim in np.flatnonzero(beside):
            added = after[sim] - before[sim]
            centre[sim, tool] += added / after[sim] * place[sim]
            axes[sim, tool], inertia[sim, tool] = principal(
                axes[sim, tool], inertia[sim, tool], before[sim] * added / after[sim], place[sim]
            )

    def _place(self) -> Array:
        """Centre of what hangs on the tool, (nsim, 3) [m]."""
        total = self.mass.sum(axis=1, keepdims=True)
        place = np.stack([self.x, self.y, self.z], axis=-1)
        weight = np.divide(self.mass, total, out=np.zeros_like(self.mass), where=total != 0)
        centre: Array = (weight[..., None] * place).sum(axis=1)
        return centre


@effect("gravity_tilt", stage="body", targets="object")
class GravityTilt(Effect):
    """Base or table are tilted about the grasp axis.

    Gravity turns by the angle in the model's frame. The robot's own gravity compensation turns with it, so that it is
    the object, and what is not compensated, that feels it.

    Formula: gravity = g · (cos(angle) down + sin(angle) across the grasp axis)

    In a recording: a free object drifts or leans; under load across the pads it slips sooner.

    Typical: below 0.05 rad.

    On the robot: put a spirit level on the base and on the table.

    Source: chosen.

    MuJoCo: ``opt.gravity``.
    """

    clause = "the base or the table is tilted about the grasp axis by {angle}"
    needs_object = False

    angle = parameter("rad", identity=0.0, default=0.1, bounds=(-0.5, 0.5))

    def change(self, now: Now) -> None:
        gravity, axis = now.host.field("opt.gravity"), now.wiring.grasp_axis
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        along = (gravity @ axis)[:, None] * axis
        tilted = along + cosine * (gravity - along) + sine * np.cross(axis, gravity)  # Rodrigues
        gravity[:] = np.where(self.present, tilted, gravity)


@effect("link_mass", stage="body", targets="joint")
class LinkMass(Effect):
    """Mass and moments of inertia of what a joint carries up to the next joint, by a factor. Gravity
    compensation lifts the nominal mass.

    Formula: mass = factor · nominal mass; inertia = factor · nominal inertia

    In a recording: joint torques follow the weight of that link over the pose, and its inertia.

    Typical: 0.9-1.1.

    On the robot: weigh the link, with its cables and covers.

    Source: chosen.

    MuJoCo: ``body_mass``, ``body_inertia``, ``body_gravcomp``.
    """

    clause = "what {t} move{s} up to the next joint weighs {factor} times the nominal mass"
    nameable = False
    own_model_prior = known_to(0.05)
    effort_prior = own_model_prior

    factor = parameter("-", identity=1.0, default=1.1, bounds=(0.3, 3.0), possible=(0.0, 1000.0))

    @classmethod
    def has_nominal_number(cls, model: mujoco.MjModel, wiring: Wiring, index: int) -> bool:
        """Not of the link that the tool is on, whose mass a :class:`Payload` adds to."""
        return bool(model.body_weldid[model.dof_bodyid[wiring.dof[index]]] != model.body_weldid[wiring.tool])

    def change(self, now: Now) -> None:
        model = now.host.model
        mass, inertia, compensation = (now.host.field(name) for name in ("body_mass", "body_inertia", "body_gravcomp"))
        for k, dof in enumerate(now.wiring.dof):
            for body in np.flatnonzero(model.body_weldid == model.dof_bodyid[dof]):
                mass[:, body] *= self.factor[:, k]
                inertia[:, body] *= self.factor[:, k, None]
                compensation[:, body] /= self.factor[:, k]  # it lifts the nominal mass, not the new one
        now.rebuild = True


class LinkCentre(Effect):
    """The centre of mass of a link lies elsewhere along one axis of the joint's body.

    Moments of inertia about the joint change by the first order in the offset, as the link's outline stays where it is:
    about the centre they fall by mass · offset², as far as there is as much. MuJoCo's compensation of gravity follows
    the centre.
    """

    nameable = False
    #: A CAD model leaves out cables and screws: of a TX40's links two centres are 5 and 22 % of the reach off.
    doubted_prior = known_to(0.05, share_of="reach")
    #: Of the joint's body, 0 to 2.
    axis: ClassVar[int]
    offset: Array

    def change(self, now: Now) -> None:
        model, place = now.host.model, now.host.field("body_ipos")
        mass, axes, inertia = (now.host.field(name) for name in ("body_mass", "body_iquat", "body_inertia"))
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)  # how bodies lie that are welded together is the same in every pose
        for k, dof in enumerate(now.wiring.dof):
            along = data.xmat[model.dof_bodyid[dof]].reshape(3, 3)[:, self.axis]
            for body in np.flatnonzero(model.body_weldid == model.dof_bodyid[dof]):
                shift = self.offset[:, k, None] * (along @ data.xmat[body].reshape(3, 3))
                place[:, body] += shift
                for sim in np.flatnonzero(self.offset[:, k]):
                    axes[sim, body], inertia[sim, body] = principal(
                        axes[sim, body], inertia[sim, body], -mass[sim, body], shift[sim]
                    )
        now.rebuild = True


@effect("link_centre_x", stage="body", targets="joint")
class LinkCentreX(LinkCentre):
    """The centre of mass of what a joint carries up to the next joint lies further along its body's x axis.

    It is never named: a diagnosis fits it where a recording's ``uncertainty`` states how well the centre is known, or
    where efforts along the motion are far more probable with it.

    Formula: centre += offset · x

    In a recording: joint torques follow that link's weight over the pose, with its arm as in another pose.

    Typical: 10 mm, 5 % of a link's length.

    On the robot: put the link with its cables on an edge across its x axis: does it balance at the nominal centre?

    Source: staubli_TX40: a CAD model's first moments of two links are 10 and 45 mm off those that were identified.

    MuJoCo: ``body_ipos``.
    """

    clause = "the centre of mass of what {t} move{s} up to the next joint lies {offset} further along x"
    axis = 0
    offset = parameter("m", identity=0.0, default=0.01, bounds=(-0.2, 0.2))


@effect("link_centre_y", stage="body", targets="joint")
class LinkCentreY(LinkCentre):
    """The centre of mass of what a joint carries up to the next joint lies further along its body's y axis.

    It is never named: a diagnosis fits it where a recording's ``uncertainty`` states how well the centre is known, or
    where efforts along the motion are far more probable with it.

    Formula: centre += offset · y

    In a recording: as ``link_centre_x``.

    Typical: 10 mm, 5 % of a link's length.

    On the robot: put the link with its cables on an edge across its y axis: does it balance at the nominal centre?

    Source: staubli_TX40: a CAD model's first moments of two links are 10 and 45 mm off those that were identified.

    MuJoCo: ``body_ipos``.
    """

    clause = "the centre of mass of what {t} move{s} up to the next joint lies {offset} further along y"
    axis = 1
    offset = parameter("m", identity=0.0, default=0.01, bounds=(-0.2, 0.2))


@effect("link_centre_z", stage="body", targets="joint")
class LinkCentreZ(LinkCentre):
    """The centre of mass of what a joint carries up to the next joint lies further along its body's z axis.

    It is never named: a diagnosis fits it where a recording's ``uncertainty`` states how well the centre is known, or
    where efforts along the motion are far more probable with it.

    Formula: centre += offset · z

    In a recording: as ``link_centre_x``.

    Typical: 10 mm, 5 % of a link's length.

    On the robot: put the link with its cables on an edge across its z axis: does it balance at the nominal centre?

    Source: staubli_TX40: a CAD model's first moments of two links are 10 and 45 mm off those that were identified.

    MuJoCo: ``body_ipos``.
    """

    clause = "the centre of mass of what {t} move{s} up to the next joint lies {offset} further along z"
    axis = 2
    offset = parameter("m", identity=0.0, default=0.01, bounds=(-0.2, 0.2))
