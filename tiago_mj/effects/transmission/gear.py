"""The gear between motor and joint: play, springs, inertia, coupling."""

from __future__ import annotations

from typing import Final

import numpy as np

from tiago_mj.effects.declare import Array, Effect, effect
from tiago_mj.effects.fields import Usual, detail, form, known_to, parameter, usually
from tiago_mj.effects.inertia import inertia_at, removable_inertia
from tiago_mj.effects.now import Now
from tiago_mj.effects.rotor import Rotor, take_inertia, take_limits
from tiago_mj.effects.servo import Servo

#: Stiffness of teeth that meet, of what a physics step bears: times inertia over the step's square; their damping, of
#: twice the critical one; and the share of the servo's force over half the play at which that takes hold (chosen).
TEETH: Final = 0.25
TEETH_DAMPING: Final = 0.6
TEETH_SHARE: Final = 0.1
#: A motor behind a gear: from a hundredth of its joint's inertia, of a link far larger than its drive, to all of it,
#: as where a gear's ratio is chosen for the fastest acceleration (chosen).
MOTOR: Final[Usual] = usually(0.1, share_of="inertia")
#: Damping of what gives between motor and joint: structures of steel and belts have 0.3 to 30 % of critical (chosen).
SPRING_DAMPING: Final[Usual] = usually(0.03, share_of="critical_damping")


@effect("backlash", stage="transmission", targets="joint", gap_class="play")
class Backlash(Effect):
    """Play between motor and joint: the joint feels the motor only when that has crossed the gap.

    The servo moves the motor, and the motor moves the joint only at either side of the gap. Without an inertia of its
    own the motor is taken to have none; what it has is taken off the joint's ``armature``. An episode starts with the
    motor at the set point, or at the side of the gap that is nearest to it. A joint that a load presses against one
    side follows the motor at once.

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
    motor = detail(("kg", "kg·m²"), (0.0, 1.0), usual=MOTOR)

    def change(self, now: Now) -> None:
        joints = list(now.wiring.targets.actuated)
        present = self.present[:, joints]
        self._has_mass = present & (self.motor[:, joints] > 0)
        self._some_light = bool((present & ~self._has_mass).any())
        if self._has_mass.any():
            self._limit = take_limits(now, self._has_mass)
            take_inertia(now, self._has_mass, self.motor[:, joints])

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
        servo = self._servo
        (joint, speed), held = servo.joint(now), servo.set_point(now)
        light = self._of_a_light_motor(joint, speed, held) if self._some_light else np.zeros_like(joint)
        if not self._has_mass.any():
            return light
        stretch = self._rotor.position - joint
        beyond = np.sign(stretch) * np.maximum(np.abs(stretch) - self._half, 0.0)
        touching = beyond != 0
        # The dampers of teeth take hold with the depth, so that their force does not jump.
        taken = np.minimum(np.abs(beyond) * self._teeth / (TEETH_SHARE * np.abs(servo.kp) * self._half + 1e-9), 1.0)
        stiff = np.where(touching, self._teeth, 0.0)
        passed = self._rotor.passed(held, speed, beyond, stiff, self._loss * taken * touching)
        passed = np.where(passed * beyond > 0, passed, 0.0)  # teeth do not pull
        own = servo.kp * (held - joint) - servo.kv * speed
        return np.where(self._has_mass, passed - own, light)

    def _of_a_light_motor(self, joint: Array, speed: Array, held: Array) -> Array:
        servo = self._servo
        self._motor = np.clip(self._free(held), joint - self._half, joint + self._half)
        apart = np.abs(self._free(held) - joint - servo.step * speed) < self._half
        pressing = -servo.kp * (self._motor - joint)
        nothing = servo.kv * speed - servo.kp * (held - joint)
        return np.where(apart, nothing, pressing)

    def _free(self, held: Array) -> Array:
        """Where a motor without load is a physics step later, held at a set point."""
        servo = self._servo
        slow = servo.kv / servo.step
        return (slow * self._motor + servo.kp * held) / (slow + servo.kp)


@effect("joint_elasticity", stage="transmission", targets="joint", gap_class="gain")
class JointElasticity(Effect):
    """A spring between motor and joint, in series with the servo.

    The motor's inertia and the spring's damping may be given: by default they are 0. What the motor has is taken off
    the joint's ``armature``. In your own model a diagnosis fits both: of 25 N·m/rad behind a motor of a twentieth of
    the joint's inertia it is 32 without them.

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
    motor = detail(("kg", "kg·m²"), (0.0, 1.0), usual=MOTOR)
    damping = detail(("N·s/m", "N·m·s/rad"), (0.0, 100.0), usual=SPRING_DAMPING)

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
        self._some_light = bool((present & ~self._has_mass).any())
        if self._has_mass.any():
            self._limit = take_limits(now, self._has_mass)
            take_inertia(now, self._has_mass, self.motor[:, servo.joints])
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
        servo = self._servo
        (joint, speed), held = servo.joint(now), servo.set_point(now)
        light = self._of_a_light_motor(joint, held) if self._some_light else np.zeros_like(joint)
        if not self._has_mass.any():
            return light
        passed = self._rotor.passed(held, speed, self._rotor.position - joint, self._spring, self._loss)
        return np.where(self._has_mass, passed - servo.kp * (held - joint), light)

    def _of_a_light_motor(self, joint: Array, held: Array) -> Array:
        self._motor = self._moved(joint, held)
        return self._spring * (self._moved(joint, held) - joint) - self._servo.kp * (held - joint)

    def _moved(self, joint: Array, held: Array) -> Array:
        """Where the motor is a physics step later, the joint being there, held at a set point."""
        kp, slow = self._servo.kp, self._kv / self._servo.step
        return (slow * self._motor + kp * held + self._spring * joint) / (slow + kp + self._spring)


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
    #: here is a finger, which is known worse: publications differ by 17 % for one with its cell.
    nominal_prior = known_to((0.35, 0.03), share_of="inertia")
    #: Other robots' slides are no such fingers: an axis that lacks a third of its carriage's mass is no nominal one.
    own_model_prior = known_to(0.03, share_of="inertia")
    effort_prior = own_model_prior
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
