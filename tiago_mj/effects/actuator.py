"""The servo and its motor: from the set point to a force on the joint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.declare import Array, Effect, effect
from tiago_mj.effects.fields import Usual, detail, known_to, parameter, usually
from tiago_mj.effects.now import Now
from tiago_mj.effects.servo import Servo

FORCE = ("N", "N·m")
DAMPING = ("N·s/m", "N·m·s/rad")


def scale_gains(now: Now, position: Array, velocity: Array) -> None:
    """Multiply the position gains (set point and feedback alike) and the velocity gains, (nsim, nactuators)."""
    ids = now.wiring.actuators
    gain, bias = now.host.field("actuator_gainprm"), now.host.field("actuator_biasprm")
    gain[:, ids, 0] *= position
    bias[:, ids, 1] *= position
    bias[:, ids, 2] *= velocity


def limit_forces(now: Now, present: NDArray[np.bool_], limit: Array) -> None:
    """Let the servos' forces saturate at ± limit, or earlier where they did, (nsim, nactuators) [N, N·m]."""
    ids = now.wiring.actuators
    limits = now.host.field("actuator_forcerange")
    unlimited = np.asarray(now.host.model.actuator_forcelimited[ids] == 0)
    low = np.where(unlimited, -np.inf, limits[:, ids, 0])
    high = np.where(unlimited, np.inf, limits[:, ids, 1])
    if unlimited.any():
        limited = now.host.field("actuator_forcelimited")
        limited[:, ids] = np.where(present & unlimited, 1, limited[:, ids])
    limits[:, ids, 0] = np.where(present, np.maximum(low, -limit), limits[:, ids, 0])
    limits[:, ids, 1] = np.where(present, np.minimum(high, limit), limits[:, ids, 1])


def set_force_limits(now: Now, present: NDArray[np.bool_], limit: Array) -> None:
    """Let the servos' forces saturate at ± limit, be that tighter or looser than the nominal one, (nsim, nactuators)
    [N, N·m]; what the joint itself lets through goes along."""
    limit = np.where(present & np.isfinite(limit), limit, np.nan)
    limit_forces(now, np.isfinite(limit), np.full_like(limit, np.inf))
    limits, ids = now.host.field("actuator_forcerange"), now.wiring.actuators
    for side, sign in enumerate((-1.0, 1.0)):
        limits[:, ids, side] = np.where(np.isfinite(limit), sign * limit, limits[:, ids, side])
    let_joints_pass(now, limit)


def let_joints_pass(now: Now, force: Array) -> None:
    """Widen the joints' own limits (``jnt_actfrcrange``) to the forces of their actuators, (nsim, nactuators) [N, N·m];
    NaN leaves a joint as it is. A limit that is stated twice, of the drive and of its joint, is one number."""
    model, ids = now.host.model, now.wiring.actuators
    joints = model.actuator_trnid[ids, 0]
    at_joint = force * np.abs(model.actuator_gear[ids, 0])
    cut = np.nan_to_num(at_joint, nan=-np.inf) > model.jnt_actfrcrange[joints, 1]
    cut &= np.asarray(model.jnt_actfrclimited[joints] != 0)
    if cut.any():
        ranges = now.host.field("jnt_actfrcrange")
        ranges[:, joints] = np.where(cut[..., None], at_joint[..., None] * (-1.0, 1.0), ranges[:, joints])


@effect("servo_stiffness", stage="actuator", targets="command", gap_class="gain")
class ServoStiffness(Effect):
    """The position gain is not the nominal one.

    Formula: force = factor · kp · (set point - position) - damping · velocity

    In a recording: a free finger moves as before but trails farther; against an object the force per set point changes;
    the largest force does not.

    Typical: 0.5-1.5: for one gripper, 1000 and 2000 N/m are in use.

    On the robot: compare the position gain set in the motor driver with the model's.

    Source: menagerie's pal_tiago and pal_gripper's controller gains.

    MuJoCo: ``actuator_gainprm``, ``actuator_biasprm``.
    """

    clause = "the position gain of {t} is {factor} times the nominal one"
    nominal_prior = known_to(0.04)
    twins = ("torque_constant",)
    needs_servo = True

    factor = parameter("-", identity=1.0, default=0.6, bounds=(0.2, 4.0))

    def change(self, now: Now) -> None:
        scale_gains(now, self.factor, np.ones_like(self.factor))


@effect("servo_damping", stage="actuator", targets="command", gap_class="damping")
class ServoDamping(Effect):
    """The servo has a derivative gain on top of the nominal one; its force stays within the servo's limit.

    Formula: force -= damping · velocity; in total never below 0; with a filter of the velocity that it gives

    In a recording: moving joints trail farther behind, in proportion to speed; nothing at rest.

    Typical: up to 80 N·s/m on the fingers.

    On the robot: compare the derivative gain set in the motor driver with the model's.

    Source: menagerie's pal_tiago (80 N·s/m in the servo, where pal_gripper has none).

    MuJoCo: ``actuator_biasprm``.
    """

    clause = "the servo of {t} has {damping} of damping that the simulator lacks"
    clause_less = "the servo of {t} has {damping} less damping than the simulator's"
    nominal_prior = known_to(0.04, share_of="stock")
    takes_from = "servo_damping"
    needs_servo = True

    damping = parameter(DAMPING, identity=0.0, default=(40.0, 5.0), bounds=((-60.0, 300.0), (-1.0, 60.0)))
    #: Time constant of the low-pass in which the drive takes the velocity from its encoder.
    filter = detail("s", (0.0, 0.1), usual=usually(0.005))
    by_detail: ClassVar[Mapping[str, str]] = {"servo_force": "filter"}

    def change(self, now: Now) -> None:
        ids, bias = now.wiring.actuators, now.host.field("actuator_biasprm")
        bias[:, ids, 2] = np.where(self.present, np.minimum(bias[:, ids, 2] - self.damping, 0.0), bias[:, ids, 2])

    def start(self, now: Now) -> None:
        if self.filter.any():
            self._servo = Servo(now)
            self._slow, _ = self._servo.joint(now)

    def servo_force(self, now: Now) -> Array:
        joint, speed = self._servo.joint(now)
        share = 1 - np.exp(-self._servo.step / np.where(self.filter > 0, self.filter, 1.0))
        estimated = (joint - self._slow) * share / self._servo.step
        self._slow = self._slow + share * (joint - self._slow)
        return np.where(self.filter > 0, self.damping * (speed - estimated), 0.0)


@effect("force_limit", stage="actuator", targets="command")
class ForceLimit(Effect):
    """The actuator saturates at another force than its nominal limit: at a lower one, as a rule.

    Formula: |force| ≤ limit; a limit of the joint itself that is tighter moves along

    In a recording: hard grasps end at a plateau, fast starts are slower; below the limit nothing changes.

    Typical: 0.3-1 of the nominal limit: for one finger, 5.2 and 16 N are in use.

    On the robot: look at the driver's current limit, the supply's voltage and the motor's temperature.

    Source: menagerie's pal_tiago and pal_gripper.

    MuJoCo: ``actuator_forcerange``, and ``jnt_actfrcrange`` where that would cut a looser one.
    """

    clause = "the force of {t} saturates at {limit}"
    nominal_prior = known_to(0.04, share_of="limit")

    limit = parameter(FORCE, identity=np.inf, default=0.4, bounds=(0.02, 1.0), nominal="effort")

    def change(self, now: Now) -> None:
        set_force_limits(now, self.present, self.limit)


@effect("torque_constant", stage="actuator", targets="command", gap_class="gain")
class TorqueConstant(Effect):
    """The delivered force is not the commanded one: all of the servo's output is scaled, its limit included.

    Formula: delivered = factor · commanded

    In a recording: as a lower servo stiffness, damping and force limit at once.

    Typical: 0.8-1.2, with temperature and between copies of a motor.

    On the robot: look at the motor's constant and the gear ratio in the driver, then at supply and temperature.

    Source: chosen.

    MuJoCo: ``actuator_gainprm``, ``actuator_biasprm``, ``actuator_forcerange``, and ``jnt_actfrcrange`` where that
    would cut what the drive gives; a ``dcmotor`` has the constant itself.
    """

    clause = "{t} deliver{s} {factor} times the commanded force"
    #: Of a motor or a torque sensor of which nothing is stated, as of the mass of a link.
    doubted_prior = known_to(0.05)

    factor = parameter("-", identity=1.0, default=0.8, bounds=(0.2, 3.0))

    def measure_effort(self, effort: Array) -> Array:
        return effort / self.factor[0]

    def change(self, now: Now) -> None:
        ids = now.wiring.actuators
        gain, bias = now.host.field("actuator_gainprm"), now.host.field("actuator_biasprm")
        gain[:, ids] *= self.factor[:, :, None]
        bias[:, ids] *= self.factor[:, :, None]
        limits = now.host.field("actuator_forcerange")
        limits[:, ids] *= self.factor[:, :, None]
        limited = np.asarray(now.host.model.actuator_forcelimited[ids] != 0)
        let_joints_pass(now, np.where(limited, limits[:, ids, 1], np.nan))


@effect("motor_cogging", stage="actuator", targets="joint")
class MotorCogging(Effect):
    """The motor's magnets add a force that is periodic over position.

    Formula: force += amplitude · (sin(2π · position / period) + second · sin(4π · position / period))

    In a recording: a ripple on effort and position whose frequency is speed over period.

    Typical: 0.01-0.05 of the rated force.

    On the robot: turn the unpowered joint by hand: do you feel steps that repeat? Look at motor and gear teeth.

    Source: chosen.

    MuJoCo: ``cogging`` of a ``dcmotor``; the project's servos are none, so the same force is applied at the joint.
    """

    clause = "{t} {has} a cogging force of {amplitude} with a period of {period}"
    ripple_period = "period"
    #: Real cogging is not quite a sine: a second harmonic of a tenth is ordinary.
    form_known_to = 0.1
    amplitude = parameter(FORCE, identity=0.0, default=1.0, bounds=(0.0, 8.0))
    period = parameter(("m", "rad"), identity=None, default=0.005, bounds=((0.001, 0.02), (0.001, 0.5)))

    #: Share of the second harmonic.
    second = detail("-", (-1.0, 1.0), usual=Usual(0.0, 0.1))

    def added_force(self, now: Now) -> Array:
        angle = 2 * np.pi * now.joint_position / self.period
        return self.amplitude * (np.sin(angle) + self.second * np.sin(2 * angle))
