"""The object between the pads: its contact, size, place and mass."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.declare import Array, Effect, effect
from tiago_mj.effects.fields import known_to, parameter
from tiago_mj.effects.now import Now
from tiago_mj.models import compliance

#: Share of its half width that an object may lack: the rest is still an object.
THINNEST: Final = 0.9


@effect("contact_stiffness", stage="contact", targets="object")
class ContactStiffness(Effect):
    """The contact of pad and object is softer or stiffer by a factor.

    Formula: force = factor · stiffness · depth + damping · d depth / dt

    In a recording: force rises more slowly or faster while the pad sinks in; against a soft position servo barely
    visible.

    Typical: 0.1-3 between a sponge and wood; behind the gripper's servo the force per set point differs by 1.3 only.

    On the robot: look at pads and object: other rubber, wear, another object than was said?

    Source: chosen; the 1.3 is force_vs_displacement's.

    MuJoCo: ``pair_solref`` in its direct format, with the stiffness in N/m by the exact law (docs/compliance.md).
    """

    clause = "the contact of pad and object is {factor} times as stiff as in the simulator"
    #: Fits of eight grasps without an effect (blind check, seed 11) moved it by 4 % (rms).
    nominal_prior = known_to(0.05)

    factor = parameter("-", identity=1.0, default=0.3, bounds=(0.05, 6.0))

    def contact_factors(self, factors: Array, now: Now) -> Array:
        return factors * _columns(self.factor, 0)


@effect("contact_damping", stage="contact", targets="object")
class ContactDamping(Effect):
    """The damping of pad and object's contact is larger or smaller by a factor.

    Formula: force = stiffness · depth + factor · damping · d depth / dt

    In a recording: the force at the instant of touch, damping · approach speed, is larger; held forces are as before.

    Typical: known to a factor of several only; few measure it.

    On the robot: look at pads and object: other rubber, wear, another object than was said?

    Source: chosen.

    MuJoCo: ``pair_solref`` (docs/compliance.md).
    """

    clause = "the contact of pad and object is {factor} times as damped as in the simulator"
    #: A grasp hardly shows it: fits of eight grasps without an effect (blind check, seed 11) moved it by 17 % (rms), in
    #: one by 45 %, which got a name where the deviation was 10 %.
    nominal_prior = known_to(0.15)

    factor = parameter("-", identity=1.0, default=4.0, bounds=(0.05, 12.0))

    def contact_factors(self, factors: Array, now: Now) -> Array:
        return factors * _columns(self.factor, 1)


@effect("contact_inertia", stage="contact", targets="object")
class ContactInertia(Effect):
    """The virtual mass of pad and object's contact is smaller or larger by a factor.

    MuJoCo's soft contacts resist relative acceleration as if a mass sat between the bodies. Reality has no such mass,
    and every engine another one: the diagnosis adjusts it beside any explanation, and never names it. Where the physics
    step would make a lighter contact unstable, it is as light as the step bears.

    Formula: force = stiffness · depth + damping · d depth / dt + factor · mass · d² depth / dt²

    In a recording: the first samples after a touch rise faster where it is smaller; held forces are as before.

    Typical: 0 in reality; 0.5-2 between simulators.

    On the robot: look for nothing: only simulators have it.

    Source: chosen; the manual's contact model (Computation, "Parameters"), measured in docs/compliance.md.

    MuJoCo: the impedance of ``pair_solimp``, with ``pair_solref`` for unchanged stiffness and damping.
    """

    clause = "the contact of pad and object has {factor} times the simulator's virtual mass"
    #: Every simulator's contacts carry another: impedances of 0.35 and 0.65 are 0.54 and 1.9 times that of 0.5.
    nominal_prior = known_to(0.5)
    nameable = False

    factor = parameter("-", identity=1.0, default=0.5, bounds=(0.05, 4.0))

    def contact_factors(self, factors: Array, now: Now) -> Array:
        return factors * _columns(self.factor, 2)


@effect("contact_friction", stage="contact", targets="object")
class ContactFriction(Effect):
    """Sliding friction of pad and object times a factor; the torsional and rolling friction with it.

    Formula: largest force across the pads = factor · µ · squeeze

    In a recording: the object slips under the same squeeze; without load across the pads nothing.

    Typical: 0.3-1.5.

    On the robot: look at the surfaces of pads and object: dust, grease, moisture, wear.

    Source: chosen.

    MuJoCo: ``pair_friction``.
    """

    clause = "the sliding friction of pad and object is {factor} times the simulator's"
    #: Fits of eight grasps without an effect (blind check, seed 11) moved it by 6 % (rms).
    nominal_prior = known_to(0.07)

    factor = parameter("-", identity=1.0, default=0.3, bounds=(0.05, 4.0))

    def change(self, now: Now) -> None:
        pairs = list(now.wiring.pairs)
        now.host.field("pair_friction")[:, pairs] *= self.factor[:, :, None]


@effect("object_size", stage="contact", targets="object", gap_class="geometry")
class ObjectSize(Effect):
    """The object is wider than said: the radius is added to its half width along the grasp.

    Formula: half width = nominal + radius, of which at least a tenth is left

    In a recording: both fingers touch earlier and rest farther apart.

    Typical: 1-3 mm of a measurement by hand.

    On the robot: measure the object with a calliper where the pads touch it.

    Source: chosen.

    MuJoCo: ``geom_size`` with its bounding volumes; the mass stays.
    """

    clause = "the object is larger by {radius} on each side than was said"
    clause_less = "the object is smaller by {radius} on each side than was said"
    nominal_prior = known_to(1.5e-4)
    takes_from = "object_half_width"

    radius = parameter("m", identity=0.0, default=0.003, bounds=(-0.015, 0.015))

    def change(self, now: Now) -> None:
        geom = now.wiring.object_geom
        if geom is None:
            return
        model = now.host.model
        size, box, tree = (now.host.field(name) for name in ("geom_size", "geom_aabb", "bvh_aabb"))
        added = np.maximum(self.radius[:, 0], -THINNEST * size[:, geom, 0])
        size[:, geom, 0] += added
        # A cylinder's radius is both horizontal extents; the body's only bounding volume is its geom's.
        extents = (3, 4) if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CYLINDER else (3,)
        for extent in extents:
            box[:, geom, extent] += added
            tree[:, model.body_bvhadr[now.wiring.object_body], extent] += added
        now.host.field("geom_rbound")[:, geom] += np.abs(added)


@effect("object_offset", stage="contact", targets="object", gap_class="geometry")
class ObjectOffset(Effect):
    """The object stands off its place along the grasp axis, positive towards the left finger.

    Formula: place = nominal + distance · (from right to left)

    In a recording: one finger touches earlier, the other later, by distance / speed.

    Typical: 1-5 mm.

    On the robot: measure where the object stands between the open fingers.

    Source: chosen.

    MuJoCo: ``qpos`` of the object's free joint at the start.
    """

    clause = "the object stands {distance} nearer to the left finger than was said"
    clause_less = "the object stands {distance} nearer to the right finger than was said"
    #: An object is placed to about a millimetre.
    nominal_prior = known_to(4e-4, per_trial=True)

    distance = parameter("m", identity=0.0, default=0.005, bounds=(-0.02, 0.02))

    def place(self, now: Now) -> None:
        first = now.wiring.object_qpos
        if first is not None:
            now.host.state("qpos")[:, first : first + 3] += self.distance * now.wiring.grasp_axis


@effect("object_mass", stage="contact", targets="object")
class ObjectMass(Effect):
    """The object is heavier or lighter by a factor, with its inertia.

    Formula: mass = factor · nominal

    In a recording: visible where one finger pushes the object over the table, or where it is lifted.

    Typical: 0.5-2.

    On the robot: weigh the object.

    Source: chosen.

    MuJoCo: ``body_mass``, ``body_inertia``; the contact's stiffness is kept.
    """

    clause = "the object has {factor} times the mass that was said"
    #: Fits of eight grasps without an effect (blind check, seed 11) moved it by 2 % (rms).
    nominal_prior = known_to(0.05)

    factor = parameter("-", identity=1.0, default=2.0, bounds=(0.1, 8.0))

    def change(self, now: Now) -> None:
        body = now.wiring.object_body
        if body is None:
            return
        now.host.field("body_mass")[:, body] *= self.factor[:, 0]
        now.host.field("body_inertia")[:, body] *= self.factor
        now.rebuild = True


def _columns(factor: Array, place: int) -> Array:
    """A factor (nsim, 1) on one of stiffness, damping and virtual mass, (nsim, 3)."""
    out = np.ones((len(factor), 3))
    out[:, place] = factor[:, 0]
    return out


def renew_contacts(now: Now, touched: NDArray[np.bool_], factors: Array) -> None:
    """Write the pads' solver parameters for the masses, stiffness and damping that each simulation now has.

    Args:
        now: after masses and their derived constants are set.
        touched: simulations whose contact an effect changes, (nsim,).
        factors: on stiffness, damping and virtual mass, (nsim, 3).
    """
    wiring = now.wiring
    assert now.contact is not None
    stiffness, damping, points = now.contact
    asked = compliance.Compliance(stiffness * factors[:, 0], damping * factors[:, 1])
    weights = now.host.field("body_invweight0")
    model = now.host.model
    step, simulated = model.opt.timestep, np.min(now.period / now.substeps)
    for pair in wiring.pairs:
        bodies = model.geom_bodyid[[model.pair_geom1[pair], model.pair_geom2[pair]]]
        weight = weights[:, bodies, 0].sum(axis=1)
        least = compliance.least_impedance(asked, weight, contact_points=points, timestep=step)
        nominal = np.maximum(least, compliance.DEFAULT_IMPEDANCE)
        lighter = nominal * factors[:, 2] / (1 - nominal + nominal * factors[:, 2])  # the mass goes with d / (1 - d)
        bearable = compliance.least_impedance(asked, weight, contact_points=points, timestep=simulated)
        values = compliance.contact_parameters(
            asked,
            weight,
            contact_points=points,
            impedance=np.where(factors[:, 2] == 1, nominal, np.maximum(lighter, bearable)),
            timestep=simulated,
        )
        now.host.field("pair_solref")[touched, pair] = values.solref[touched]
        now.host.field("pair_solimp")[touched, pair] = values.solimp[touched]
