"""Friction of joints, and a constant force on them."""

from __future__ import annotations

from typing import Final

import numpy as np

from tiago_mj.effects.actuator import DAMPING, FORCE
from tiago_mj.effects.declare import Array, Effect, effect
from tiago_mj.effects.fields import detail, known_to, parameter, usually
from tiago_mj.effects.now import Now
from tiago_mj.effects.transmission.bounded_speed import SPEED

#: Solver parameters with which dry friction sticks. MuJoCo's defaults creep: a servo held 0.9 mm off by 2 N of friction
#: is back within 0.5 s; with these it is 0.88 mm off after 10 s (facts measured on the gripper's servo). The time
#: constant is as short as the step allows, which is two of it: against real bristles a hinge's Coulomb friction leaves
#: 1.14 noise variances with it at a step of 0.5 ms, and 1.6 with 2 ms (benchmarks/truth_audit).
STICKING_SOLIMP: Final = (0.9999, 0.9999, 0.001, 0.5, 2.0)
STICKING_SOLREF: Final = (0.0005, 1.0)
#: What dry friction does where a joint comes to rest depends on how far it gives before it slides, which no parameter
#: says: bristles and a rigid contact differ there by about this share.
DRY: Final = 0.1
#: Where friction falls with speed, more: a joint that slows down stops all at once, somewhere.
FALLING: Final = 0.2


def let_it_stick(effect: Effect, now: Now, share: Array | None = None) -> None:
    """Give the joints that have the effect the solver parameters with which dry friction holds.

    Args:
        effect, now: whose targets are joints.
        share: of the joint's friction that holds, (nsim, njoints); the rest creeps as the nominal model's does. Between
            the two the odds of the impedance and the time constant go along logarithmically, so that a little more
            friction is a little change. None: all of it holds.
    """
    if share is None:
        now.fill("dof_solimp", effect.present, STICKING_SOLIMP)
        now.fill("dof_solref", effect.present, STICKING_SOLREF)
        return
    dofs, w = now.wiring.dof, np.where(effect.present, share, 0.0)
    mixed = effect.present & (w > 0)
    if not mixed.any():
        return
    impedance, reference = now.host.field("dof_solimp"), now.host.field("dof_solref")
    for column in (0, 1):
        before = impedance[:, dofs, column]
        odds = np.log(before / (1 - before)) * (1 - w) + np.log(1 / (1 / STICKING_SOLIMP[column] - 1)) * w
        impedance[:, dofs, column] = np.where(mixed, 1 / (1 + np.exp(-odds)), before)
    seconds = reference[:, dofs, 0]
    direct = seconds <= 0  # stiffness and damping instead of a time constant: nothing to go along from
    between = np.where(direct, STICKING_SOLREF[0], np.abs(seconds) ** (1 - w) * STICKING_SOLREF[0] ** w)
    reference[:, dofs, 0] = np.where(mixed, between, seconds)
    reference[:, dofs, 1] = np.where(mixed & direct, STICKING_SOLREF[1], reference[:, dofs, 1])


def sticking_share(nominal: Array, added: Array) -> Array:
    """How far a joint's friction holds: the square of what was added over what the nominal model has, at most all.

    No real joint's friction creeps as the nominal model's does: it does no longer where as much again was added. A
    nominal number that is off by some per cent goes on creeping.
    """
    added = np.maximum(added, 0.0)
    return np.where(added >= nominal, added > 0, added / np.where(nominal > 0, nominal, 1.0)) ** 2


@effect("coulomb_friction", stage="transmission", targets="joint", gap_class="friction")
class CoulombFriction(Effect):
    """Dry friction beyond the nominal: constant against motion, and it sticks.

    Formula: force -= friction · sign(velocity); at rest it balances up to the friction; nominal plus additional never
    below 0

    In a recording: set points trail by force / stiffness, with a jump of twice that at each reversal; small set-point
    changes do nothing.

    Typical: 0.013, 0.10, 4.1 N·m from small to large servos; 2 N on PAL's fingers; 2.1, 5.0, 2.7, 2.2 N·m on TIAGo's
    arm_1-4 against 1 in its URDF.

    On the robot: look at the joint's bearing, seals and cables: does something rub or lack grease?

    Source: BAM; pal_gripper; fitted on tiago_arm.

    MuJoCo: ``dof_frictionloss``, with solver parameters that hold as far as the friction is the effect's: the default
    ones let a joint creep back within 0.5 s.
    """

    clause = "{t} {has} {force} of Coulomb friction that the simulator lacks"
    clause_less = "{t} {has} {force} less Coulomb friction than the simulator"
    nominal_prior = known_to(0.04, share_of="stock")
    takes_from = "frictionloss"
    form_known_to = DRY
    force = parameter(FORCE, identity=0.0, default=3.0, bounds=((-2.0, 12.0), (-1.0, 15.0)))

    def change(self, now: Now) -> None:
        friction = now.host.field("dof_frictionloss")
        nominal = friction[:, now.wiring.dof].copy()
        friction[:, now.wiring.dof] = np.maximum(nominal + self.force, 0.0)
        let_it_stick(self, now, sticking_share(nominal, self.force))


@effect("viscous_friction", stage="transmission", targets="joint", gap_class="damping")
class ViscousFriction(Effect):
    """Linear damping of the joint beyond the nominal.

    Formula: force -= damping · velocity; nominal plus additional never below 0

    In a recording: as servo damping, but not bounded by the servo's force limit: trailing in proportion to speed.

    Typical: 0.0037, 0.035, 1.30 N·m·s/rad from small to large servos; 80 N·s/m on PAL's fingers; 28, 13, 5.7, 4.3
    N·m·s/rad on TIAGo's arm_1-4 against 1 in its URDF.

    On the robot: look at the grease of gear and bearing: too thick, too much, or cold?

    Source: BAM; pal_gripper; fitted on tiago_arm.

    MuJoCo: ``dof_damping``.
    """

    clause = "{t} {has} {damping} of viscous friction that the simulator lacks"
    clause_less = "{t} {has} {damping} less viscous friction than the simulator"
    nominal_prior = known_to(0.04, share_of="stock")
    twins = ("servo_damping",)
    takes_from = "damping"

    damping = parameter(DAMPING, identity=0.0, default=(40.0, 5.0), bounds=((-80.0, 400.0), (-1.0, 60.0)))

    def change(self, now: Now) -> None:
        damping = now.host.field("dof_damping")
        damping[:, now.wiring.dof] = np.maximum(damping[:, now.wiring.dof] + self.damping, 0.0)


@effect("stribeck_friction", stage="transmission", targets="joint", gap_class="friction")
class StribeckFriction(Effect):
    """Extra breakaway friction that fades with speed.

    Formula: friction += static · exp(-(v / velocity)²)

    In a recording: stick-slip at low speed, a jerk at every start, nothing in fast motion.

    Typical: 0.2-1 of the Coulomb friction, gone at 5-20 mm/s.

    On the robot: start the joint slowly: does it stick and jump? Look at bearing, seals and grease.

    Source: chosen.

    MuJoCo: ``lugre`` of a ``dcmotor`` holds a Stribeck curve; here ``dof_frictionloss`` is renewed in every physics
    step.
    """

    clause = "{t} {has} {static} of breakaway friction, gone above {velocity}, that the simulator lacks"
    form_known_to = FALLING
    static = parameter(FORCE, identity=0.0, default=3.0, bounds=(0.0, 12.0))
    velocity = parameter(SPEED, identity=None, default=0.01, bounds=((0.001, 0.05), (0.001, 0.5)))

    def change(self, now: Now) -> None:
        nominal = now.host.field("dof_frictionloss")[:, now.wiring.dof]
        let_it_stick(self, now, sticking_share(nominal, self.static))

    def added_friction(self, now: Now) -> Array:
        return self.static * np.exp(-np.square(now.joint_velocity / self.velocity))


@effect("load_dependent_friction", stage="transmission", targets="joint", gap_class="friction")
class LoadDependentFriction(Effect):
    """Friction that grows with the transmitted force.

    Formula: friction += coefficient · |actuator force|, the weight that the actuator lifts included

    In a recording: free motion is as nominal; under load, forces differ between closing and opening by twice the share.

    Typical: 0.05-0.3 in worm and screw drives.

    On the robot: look at gear and bearing under load: wear, lack of grease, a screw or belt too tight.

    Source: chosen; BAM fits load-dependent friction as one of its models.

    MuJoCo: none; ``dof_frictionloss`` is renewed in every physics step.
    """

    clause = "{t} {has} friction of {coefficient} times the transmitted force"
    form_known_to = DRY
    coefficient = parameter("-", identity=0.0, default=0.15, bounds=(0.0, 0.8))
    #: Time constant with which friction follows the force, as a gear gives.
    lag = detail("s", (0.0, 0.1), usual=usually(0.005))
    #: What the gear carries with its lag; None: it has none, or no simulation began (efforts along a measured motion).
    _carried: Array | None = None

    def change(self, now: Now) -> None:
        let_it_stick(self, now)

    def start(self, now: Now) -> None:
        self._carried = np.zeros_like(self.coefficient) if self.lag.any() else None

    def added_friction(self, now: Now) -> Array:
        load = np.abs(now.joint_effort)
        if self._carried is not None:
            step = now.period / now.substeps
            share = np.where(self.lag > 0, -np.expm1(-step / np.where(self.lag > 0, self.lag, 1.0)), 1.0)
            self._carried = load = self._carried + share * (load - self._carried)
        return self.coefficient * load


@effect("asymmetric_friction", stage="transmission", targets="joint")
class AsymmetricFriction(Effect):
    """Dry friction that is larger by the force in the positive direction and smaller by it in the negative, though
    never below 0.

    Formula: friction += force · sign(velocity)

    In a recording: the error at constant speed differs between opening and closing.

    Typical: a quarter of the friction.

    On the robot: move the unpowered joint both ways by hand; look at cables, hoses and springs that pull one way.

    Source: chosen.

    MuJoCo: none; ``dof_frictionloss`` at the mean of both directions, and half their difference as a force: together
    they hold a joint at rest as each direction does.
    """

    clause = "the dry friction of {t} is larger by {force} in the positive direction"
    clause_less = "the dry friction of {t} is larger by {force} in the negative direction"
    form_known_to = DRY
    force = parameter(FORCE, identity=0.0, default=2.0, bounds=(-10.0, 10.0))

    def change(self, now: Now) -> None:
        let_it_stick(self, now)
        friction = now.host.field("dof_frictionloss")
        forward, back = (np.maximum(friction[:, now.wiring.dof] + sign * self.force, 0.0) for sign in (1, -1))
        friction[:, now.wiring.dof] = np.where(self.present, (forward + back) / 2, friction[:, now.wiring.dof])
        self._pushes = (back - forward) / 2

    def added_force(self, now: Now) -> Array:
        return self._pushes


@effect("torque_offset", stage="transmission", targets="joint")
class TorqueOffset(Effect):
    """A constant force or torque on a joint that the model lacks.

    Formula: joint force += force

    In a recording: efforts and the servo's error are off by the same at every speed and in every pose.

    Typical: 2 % of the largest effort: a cable, a worn balancer; a torque sensor's zero looks the same.

    On the robot: read the effort of the unpowered joint in a pose in which it carries nothing.

    Source: regressions of public recordings (``benchmarks/real/regression.py``): over nine joints of EMPS, the double
    pendulum and TIAGo's arm the root mean square is 1.9 % of the largest measured effort.

    MuJoCo: none; ``qfrc_applied``.
    """

    clause = "a constant {force} acts on {t} that the model lacks"
    nameable = False
    effort_prior = known_to(0.02, share_of="effort")

    force = parameter(FORCE, identity=0.0, default=1.0, bounds=(-10.0, 10.0))

    def added_force(self, now: Now) -> Array:
        return self.force
