"""Friction in a motor that turns with two joints, as in coupled wrists, differentials and arms driven by cables."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from tiago_mj.effects.actuator import DAMPING, FORCE
from tiago_mj.effects.declare import Array, Effect, effect
from tiago_mj.effects.fields import form, parameter
from tiago_mj.effects.inertia import inertia_at
from tiago_mj.effects.now import Now
from tiago_mj.effects.tendons import Tendon
from tiago_mj.effects.transmission.friction import DRY, STICKING_SOLIMP, STICKING_SOLREF
from tiago_mj.effects.transmission.gear import TEETH, TEETH_DAMPING


class CoupledMotor(Effect, ABC):
    """A force of a motor that turns with a joint and the joint that carries it."""

    reaches_carrier = True
    #: 1: the motor turns with the difference of the two, as its gear turns the other way.
    against = form(0, 1)

    def start(self, now: Now) -> None:
        own, carrying = inertia_at(now), now.wiring.carrier
        self._step = now.period / now.substeps
        # Of the motor's turning at least: half of the harmonic sum, however the two joints' motions are coupled.
        self._inertia = 0.5 / (1 / own + 1 / own[:, carrying])

    def added_force(self, now: Now) -> Array:
        carrying = now.wiring.carrier
        turns = np.where(self.against > 0, -1.0, 1.0)
        speed = now.joint_velocity + turns * now.joint_velocity[:, carrying]
        mine = np.where(self.present & (carrying >= 0), self.on_motor(speed, now.host.simulates), 0.0)
        force: Array = mine.copy()
        for joint in np.flatnonzero(carrying >= 0):
            force[:, carrying[joint]] += (turns * mine)[:, joint]
        return force

    def model_tendons(self, now: Now) -> Sequence[Tendon]:
        joints, out = now.wiring.targets.joint, []
        for k in np.flatnonzero(self.present[0] & (now.wiring.carrier >= 0)).tolist():
            turns = ((joints[now.wiring.carrier[k]], -1.0 if self.against[0, k] > 0 else 1.0), (joints[k], 1.0))
            out.append(Tendon(f"{joints[k]}_{self.name}", turns, self.in_tendon(k)))
        return out

    @abstractmethod
    def in_tendon(self, joint: int) -> tuple[tuple[str, tuple[float, ...]], ...]:
        """Numbers of the tendon of a joint's motor (:class:`~tiago_mj.effects.tendons.Tendon`)."""

    @abstractmethod
    def on_motor(self, speed: Array, simulates: bool) -> Array:
        """Force on the motor, on the joint's side, (nsim, njoints) [N, N·m].

        Args:
            speed: of the motor there, (nsim, njoints) [m/s, rad/s].
            simulates: whether a physics step follows; else the motion is given.
        """


@effect("coupled_motor_friction", stage="transmission", targets="joint")
class CoupledMotorFriction(CoupledMotor):
    """Dry friction in a motor that turns with a joint and with the joint that carries it: it acts on both.

    The motor of a wrist's last joint often sits before the joint that carries it, which turns it, too; in a
    differential either motor turns with both joints. Their speeds count alike, as where the gears of both have one
    ratio.

    Formula: joint force -= force · sign(velocity + carrier's velocity), and the carrier's force by the same; with
    against = 1 of the difference, and the carrier's force by the opposite

    In a recording: the effort of one joint jumps where the sum of two joints' speeds turns round.

    Typical: 2 N·m on the wrist of a small industrial arm.

    On the robot: move the two joints against each other so that their sum stays, then together: is it harder?

    Source: staubli_TX40: 2.03 N·m.

    MuJoCo: ``frictionloss`` of a fixed tendon over both joints, as repaired models have it; here a force that gives
    elastically until it slides.
    """

    clause = "a motor that turns with {t} and with the joint before has {force} of Coulomb friction"
    form_known_to = DRY
    force = parameter(FORCE, identity=0.0, default=2.0, bounds=((0.0, 12.0), (0.0, 15.0)))

    def start(self, now: Now) -> None:
        super().start(now)
        self._stiffness = TEETH * self._inertia / self._step**2
        self._damping = TEETH_DAMPING * np.sqrt(self._stiffness * self._inertia)
        self._stretch = np.zeros_like(self.force)

    def on_motor(self, speed: Array, simulates: bool) -> Array:
        if not simulates:  # a motor that holds still while both joints move creeps the way in which it is pushed
            return -self.force * np.sign(speed)
        most = self.force / self._stiffness
        self._stretch = np.clip(self._stretch + speed * self._step, -most, most)
        return -np.clip(self._stiffness * self._stretch + self._damping * speed, -self.force, self.force)

    def in_tendon(self, joint: int) -> tuple[tuple[str, tuple[float, ...]], ...]:
        sticks = (("solref_friction", STICKING_SOLREF), ("solimp_friction", STICKING_SOLIMP))
        return (("frictionloss", (float(self.force[0, joint]),)), *sticks)


@effect("coupled_motor_damping", stage="transmission", targets="joint")
class CoupledMotorDamping(CoupledMotor):
    """Viscous friction in a motor that turns with a joint and with the joint that carries it: it acts on both.

    Formula: joint force -= damping · (velocity + carrier's velocity), and the carrier's force by the same; with
    against = 1 of the difference, and the carrier's force by the opposite

    In a recording: the effort of one joint follows the speed of the other.

    Typical: 0.6 N·m·s/rad on the wrist of a small industrial arm.

    On the robot: hold the last joint and turn the one before it: does the last motor turn?

    Source: staubli_TX40: 0.597 N·m·s/rad.

    MuJoCo: ``damping`` of a fixed tendon over both joints, as repaired models have it.
    """

    clause = "a motor that turns with {t} and with the joint before has {damping} of viscous friction"
    damping = parameter(DAMPING, identity=0.0, default=(10.0, 1.0), bounds=((0.0, 400.0), (0.0, 60.0)))

    def on_motor(self, speed: Array, simulates: bool) -> Array:
        damping = self.damping
        if simulates:  # what would stop it within a physics step is the most that is taken
            damping = np.minimum(damping, self._inertia / self._step)
        return -damping * speed

    def in_tendon(self, joint: int) -> tuple[tuple[str, tuple[float, ...]], ...]:
        return (("damping", (float(self.damping[0, joint]),)),)
