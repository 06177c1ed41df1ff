"""Between motor and joint: friction, play, springs, inertia."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.actuator import DAMPING, FORCE, limit_forces
from tiago_mj.effects.declare import Array, Effect, effect
from tiago_mj.effects.fields import detail, form, known_to, parameter
from tiago_mj.effects.inertia import removable_inertia
from tiago_mj.effects.now import Now
from tiago_mj.effects.rotor import Rotor, take_limits
from tiago_mj.effects.servo import Servo

SPEED = ("m/s", "rad/s")

#: Solver parameters with which dry friction sticks. MuJoCo's defaults creep: a servo held 0.9 mm off by 2 N of friction
#: is back within 0.5 s; with these it is 0.88 mm off after 10 s (facts measured on the gripper's servo). The time
#: constant is as short as the step allows, which is two of it: against real bristles a hinge's Coulomb friction leaves
#: 1.14 noise variances with it at a step of 0.5 ms, and 1.6 with 2 ms (benchmarks/truth_audit.py).
STICKING_SOLIMP: Final = (0.9999, 0.9999, 0.001, 0.5, 2.0)
STICKING_SOLREF: Final = (0.0005, 1.0)
#: What dry friction does where a joint comes to rest depends on how far it gives before it slides, which no parameter
#: says: bristles and a rigid contact differ there by about this share.
DRY: Final = 0.1
#: Where friction falls with speed, more: a joint that slows down stops all at once, somewhere.
FALLING: Final = 0.2
#: Shares of what a new estimate of the load is off by that go into the running one and, while the limit holds, into how
#: fast it grows. Pressed into an object, the load grows by some 100 N/s: without the second share a joint at its limit
#: fell back to half of it. In a start at full force the limit is exceeded by 4 %, for some milliseconds.
LOAD_UPDATE: Final = 0.4
RISE_UPDATE: Final = 0.1


#: Stiffness of teeth that meet, of what a physics step bears: times inertia over the step's square; their damping, of
#: twice the critical one; and the share of the servo's force over half the play at which that takes hold (chosen).
TEETH: Final = 0.25
TEETH_DAMPING: Final = 0.6
TEETH_SHARE: Final = 0.1


def inertia_at(now: Now) -> Array:
    """Effective inertia of the joints where each simulation stands, of its own masses and inertias, (nsim, njoints)
    [kg, kg·m²]."""
    host, positions = now.host, now.host.state("qpos")
    if now.rebuild:
        return np.stack([_inertia(*one, now.wiring.dof) for one in zip(host.models(), positions, strict=True)])
    poses, which = np.unique(positions, axis=0, return_inverse=True)
    return np.stack([_inertia(host.model, pose, now.wiring.dof) for pose in poses])[which]


def _inertia(model: mujoco.MjModel, pose: Array, dofs: NDArray[np.intp]) -> Array:
    """Inverse of the diagonal of the inverse mass matrix, (n,) [kg, kg·m²], of the joints at these addresses."""
    data, inverse = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    data.qpos[:] = pose
    mujoco.mj_forward(model, data)
    mujoco.mj_solveM(model, data, inverse, np.eye(model.nv))
    effective: Array = 1 / np.diag(inverse)[dofs]
    return effective


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
    lag = detail("s", (0.0, 0.1), sought=False)
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


@effect("backlash", stage="transmission", targets="joint", gap_class="play")
class Backlash(Effect):
    """Play between motor and joint: the joint feels the motor only when that has crossed the gap.

    The servo moves the motor, and the motor moves the joint only at either side of the gap. Without an inertia of its
    own the motor is taken to have none. An episode starts with the motor at the set point, or at the side of the gap
    that is nearest to it. A joint that a load presses against one side follows the motor at once.

    Formula: |motor - joint| ≤ width / 2; between the sides no force, at a side the servo's

    In a recording: after each reversal in the air the joint waits while the command moves by the width; pressing, the
    servo's error is larger by half of it.

    Typical: 0.1-1 mm on screw-driven fingers, 10-30 mrad on hobby servos.

    On the robot: hold the motor and wiggle the joint by hand; look at gear, coupling and keys for play.

    Source: chosen.

    MuJoCo: none; a second joint with a gap would do it at the price of one more degree of freedom. Here the difference
    to the servo's own force is a bias of the actuator, ``actuator_biasprm``.
    """

    clause = "{t} {has} {width} of play that the simulator lacks"
    needs_servo = True

    width = parameter(("m", "rad"), identity=0.0, default=0.001, bounds=((0.0, 0.006), (0.0, 0.1)))
    motor = detail("kg, kg·m²", (0.0, 1.0), sought=False)

    def change(self, now: Now) -> None:
        joints = list(now.wiring.targets.actuated)
        self._has_mass = self.present[:, joints] & (self.motor[:, joints] > 0)
        if self._has_mass.any():
            self._limit = take_limits(now, self._has_mass)

    def start(self, now: Now) -> None:
        self._servo = servo = Servo(now)
        self._half = self.width[:, self._servo.joints] * self._servo.ratio / 2
        joint, _ = self._servo.joint(now)
        # Before anything was commanded the servo holds the motor as far as the gap lets it.
        self._motor = np.clip(self._servo.set_point(now), joint - self._half, joint + self._half)
        if self._has_mass.any():
            inertia = np.where(self._has_mass, self.motor[:, servo.joints] / servo.ratio**2, 1.0)
            self._rotor = Rotor(now, inertia, self._motor.copy(), servo.kv, self._limit)
            whole = inertia_at(now)[:, servo.joints] / servo.ratio**2
            self._teeth = TEETH * whole / servo.step**2
            self._loss = TEETH_DAMPING * np.sqrt(self._teeth * whole)

    def servo_force(self, now: Now) -> Array:
        light = self._of_a_light_motor(now)
        if not self._has_mass.any():
            return light
        servo = self._servo
        joint, speed = servo.joint(now)
        stretch = self._rotor.position - joint
        beyond = np.sign(stretch) * np.maximum(np.abs(stretch) - self._half, 0.0)
        touching = beyond != 0
        # The dampers of teeth take hold with the depth, so that their force does not jump.
        taken = np.minimum(np.abs(beyond) * self._teeth / (TEETH_SHARE * np.abs(servo.kp) * self._half + 1e-9), 1.0)
        passed = self._rotor.passed(now, beyond, np.where(touching, self._teeth, 0.0), self._loss * taken * touching)
        passed = np.where(passed * beyond > 0, passed, 0.0)  # teeth do not pull
        own = servo.kp * (servo.set_point(now) - joint) - servo.kv * speed
        return np.where(self._has_mass, passed - own, light)

    def _of_a_light_motor(self, now: Now) -> Array:
        servo = self._servo
        joint, speed = servo.joint(now)
        self._motor = np.clip(self._free(now), joint - self._half, joint + self._half)
        apart = np.abs(self._free(now) - joint - servo.step * speed) < self._half
        pressing = -servo.kp * (self._motor - joint)
        nothing = servo.kv * speed - servo.kp * (servo.set_point(now) - joint)
        return np.where(apart, nothing, pressing)

    def _free(self, now: Now) -> Array:
        """Where a motor without load is a physics step later."""
        servo = self._servo
        slow = servo.kv / servo.step
        return (slow * self._motor + servo.kp * servo.set_point(now)) / (slow + servo.kp)


@effect("joint_elasticity", stage="transmission", targets="joint", gap_class="gain")
class JointElasticity(Effect):
    """A spring between motor and joint, in series with the servo, which holds a motor without mass.

    Where the motor's inertia is given it has that, and the spring the damping that is given.

    Formula: stiffness · (motor - joint) = kp · (set point - motor) - kv · motor velocity; at rest the stiffness felt at
    the joint is 1 / (1 / kp + 1 / stiffness)

    In a recording: as a lower servo stiffness; the force per set point falls, and with it what the servo's damping can
    do for the joint.

    Typical: 1-5 times the servo's stiffness.

    On the robot: hold the motor and press against the joint; look at belt, coupling and gear for what gives.

    Source: chosen.

    MuJoCo: a joint with ``stiffness`` on a body between motor and link; here the difference to the servo's own force is
    a bias of the actuator, ``actuator_biasprm``; the resonance with the motor's mass is there where that is given.
    """

    clause = "{t} {is} driven through a spring of {stiffness}"
    needs_servo = True

    stiffness = parameter(
        ("N/m", "N·m/rad"), identity=np.inf, default=3000.0, bounds=((300.0, 40_000.0), (1.0, 40_000.0))
    )
    motor = detail("kg, kg·m²", (0.0, 1.0), sought=False)
    damping = detail("N·s/m, N·m·s/rad", (0.0, 100.0), sought=False)

    def change(self, now: Now) -> None:
        # The servo's damping acts on the motor; what of it reaches the joint at once is integrated implicitly, as the
        # servo's own was.
        servo = Servo(now)
        present = self.present[:, servo.joints]
        self._spring = np.where(present, self.stiffness[:, servo.joints] / servo.ratio**2, 1.0)
        self._kv = servo.kv
        reaching = self._spring * servo.kv / (servo.kv / servo.step + servo.kp + self._spring)
        bias = now.host.field("actuator_biasprm")
        self._has_mass = present & (self.motor[:, servo.joints] > 0)
        if self._has_mass.any():
            self._limit = take_limits(now, self._has_mass)
        bias[:, now.wiring.actuators, 2] = -np.where(present, np.where(self._has_mass, 0.0, reaching), servo.kv)

    def start(self, now: Now) -> None:
        self._servo = servo = Servo(now)
        joint, _ = servo.joint(now)
        self._motor = (servo.kp * servo.set_point(now) + self._spring * joint) / (servo.kp + self._spring)
        if self._has_mass.any():
            inertia = np.where(self._has_mass, self.motor[:, servo.joints] / servo.ratio**2, 1.0)
            self._rotor = Rotor(now, inertia, self._motor.copy(), self._kv, self._limit)
            self._loss = self.damping[:, servo.joints] / servo.ratio**2

    def servo_force(self, now: Now) -> Array:
        light = self._of_a_light_motor(now)
        if not self._has_mass.any():
            return light
        servo = self._servo
        joint, _ = servo.joint(now)
        passed = self._rotor.passed(now, self._rotor.position - joint, self._spring, self._loss)
        return np.where(self._has_mass, passed - servo.kp * (servo.set_point(now) - joint), light)

    def _of_a_light_motor(self, now: Now) -> Array:
        servo = self._servo
        joint, _ = servo.joint(now)
        self._motor = self._moved(now, joint)
        return self._spring * (self._moved(now, joint) - joint) - servo.kp * (servo.set_point(now) - joint)

    def _moved(self, now: Now, joint: Array) -> Array:
        """Where the motor is a physics step later, the joint being there."""
        servo = self._servo
        slow = self._kv / servo.step
        return (slow * self._motor + servo.kp * servo.set_point(now) + self._spring * joint) / (
            slow + servo.kp + self._spring
        )


@effect("armature", stage="transmission", targets="joint")
class Armature(Effect):
    """Reflected inertia of motor and gear beyond the nominal.

    Formula: (inertia + mass) · acceleration = force

    A negative value takes from the joint's inertia: at most 90 % of what moves with a joint that moves alone and 99 %
    of its motor's (``armature``), in a chain of joints 30 % of the one, or less where the mass matrix would not be
    positive definite in any pose, and all of the other.

    In a recording: slower starts and stops, overshoot; nothing at constant speed.

    Typical: 0.0018, 0.027, 0.34 kg·m² from small to large servos.

    On the robot: compare the rotor's inertia times the gear ratio squared with the model's.

    Source: BAM.

    MuJoCo: ``dof_armature``.
    """

    clause = "{t} {has} {mass} of reflected inertia that the simulator lacks"
    clause_less = "{t} {has} {mass} less reflected inertia than the simulator"
    #: Beside payload and links, which have their own, fits of grasps moved a hinge's inertia by 1 to 2 %. What slides
    #: is known worse: publications differ by 17 % for a finger with its cell.
    nominal_prior = known_to((0.35, 0.03), share_of="inertia")
    #: Along a motion links have their own prior on a slide, too, and no finger is published for other robots.
    effort_prior = known_to(0.03, share_of="inertia")
    takes_from = "inertia"

    _least: Array | None = None

    mass = parameter(("kg", "kg·m²"), identity=0.0, default=0.3, bounds=((-0.08, 5.0), (-0.1, 3.0)))

    def change(self, now: Now) -> None:
        armature, dofs = now.host.field("dof_armature"), now.wiring.dof
        before = armature[:, dofs]
        if self._least is None:
            model = now.host.model
            # Of a motion that is given any inertia makes a torque; what is simulated needs one that moves.
            self._least = np.full(len(dofs), 0.0 if now.host.simulates else -np.inf)
            if (self.mass < 0).any() and now.host.simulates:
                self._least = model.dof_armature[dofs] - removable_inertia(model, dofs)
        armature[:, dofs] = np.where(self.present, np.maximum(before + self.mass, self._least), before)
        now.rebuild = True


@effect("coupling_error", stage="transmission", targets="joint")
class CouplingError(Effect):
    """Part of one joint's motion appears on its neighbour (of one finger's on the other).

    Formula: set point += ratio · (the partner's set point - where that began); with of_motion = 1 of the partner's
    position instead of its set point

    In a recording: a joint moves that was not commanded.

    Typical: 0-0.1 where two fingers share a carriage.

    On the robot: move the neighbouring joint alone and watch this one; look at tendons, belts and differential gears.

    Source: chosen.

    MuJoCo: an ``equality/joint`` couples positions rigidly; here it is the set points.
    """

    clause = "{ratio%} of the neighbouring joint's motion appears on {t}"
    fewest_targets = 2
    needs_servo = True

    ratio = parameter("-", identity=0.0, default=0.1, bounds=(-0.6, 0.6))
    of_motion = form(0, 1)

    def start(self, now: Now) -> None:
        joints = list(now.wiring.targets.actuated)
        self._servo, self._home = Servo(now), now.joint_position[:, joints]
        self._ratio, self._moving = self.ratio[:, joints], self.of_motion[:, joints] > 0

    def set_point(self, target: Array, now: Now) -> Array:
        partner = now.wiring.partner
        return target + np.where(self._moving, 0.0, self._ratio * (target - now.set_point)[:, partner])

    def servo_force(self, now: Now) -> Array:
        moved = (now.joint_position[:, self._servo.joints] - self._home)[:, now.wiring.partner]
        return np.where(self._moving, self._servo.kp * self._servo.ratio * self._ratio * moved, 0.0)
