"""Torque that a motion needs with effects in the model: every effect by its own declaration.

A row of the motion stands for a simulation: the declarations' hooks see joint positions, velocities and efforts of all
rows at once. Their changes to the model go into a copy of it, with which inverse dynamics runs along the motion.
Contacts, joint limits and gravity compensation are off. Dry friction is force · sign(velocity), with a straight line
through rest: MuJoCo's own, being soft, would creep there.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS, Effect, Entry
from tiago_mj.effects.chain import Now, Wiring
from tiago_mj.effects.declare import overrides
from tiago_mj.effects.spec import arrays
from tiago_mj.effects.wiring import wire
from tiago_mj.gap.torque.strips import Course
from tiago_mj.io.deadline import Deadline

Array = NDArray[np.float64]

#: Stages whose effects change what torque a motion needs, or which motion it was.
STAGES: Final = ("actuator", "transmission", "body", "joint_sensor")
#: Fields that are accounted for outside inverse dynamics, joint by joint.
JOINT_FIELDS: Final = ("dof_frictionloss", "dof_damping", "dof_armature")
#: Results of inverse dynamics that are kept: a fit asks for the same masses beside many frictions.
KEPT: Final = 256
#: Departure from proportion at half the default, as a share of what the default changes, below which an effect is
#: linear: rounding, and what is below the tolerance of a torque (:data:`tiago_mj.gap.torque.measured.METHOD`).
EXACTLY: Final = 1e-9
LINEAR: Final = 1e-3
#: Rounds at most in which the load that friction follows is found, and the change of a torque, as a share of the
#: largest, at which it is: a tenth of :data:`LINEAR`. A share of 0.8, the most there is, takes 40 rounds.
MAX_LOAD_ROUNDS: Final = 40
LOAD_SETTLED: Final = 1e-4


class Torques:
    """Torques along one course.

    Args:
        model: nominal; it is copied.
        course: the motion.
        given: effects that are known already: part of every torque.
        deadline: asked before every torque that is computed; None: there is none. It may be set anew.

    Raises:
        ValueError: the model lacks a joint of the course.
    """

    def __init__(
        self, model: mujoco.MjModel, course: Course, given: Sequence[Entry] = (), deadline: Deadline | None = None
    ) -> None:
        self.course = course
        self.deadline = deadline or Deadline()
        self._model = copy.copy(model)
        self._model.body_gravcomp[:] = 0.0
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
        self.wiring = _wiring(self._model, course.joints)
        self._given = tuple(entry for entry in given if self._acts(entry))
        self.motion: tuple[Array, ...] = tuple(course.stack(q) for q in ("position", "velocity", "acceleration"))
        self._joint = {name: getattr(self._model, name)[self.wiring.dof].copy() for name in JOINT_FIELDS}
        for name in JOINT_FIELDS:
            getattr(self._model, name)[:] = 0.0
        self._nominal: Array | None = None
        self._kept: dict[tuple[Entry, ...], Array] = {}
        self._rigid: dict[tuple[str, tuple[str, ...] | None], bool] = {}

    def _acts(self, entry: Entry) -> bool:
        """Whether an effect that is given changes torques here: not where it rounds readings, whose grid is part of
        their noise, nor on a joint that takes no part in the motion."""
        declared = EFFECTS[entry.name]
        there = self.wiring.targets.names(declared.targets)
        return declared.stage in STAGES and not declared.rounds and set(entry.target or ()) <= set(there)

    @property
    def model(self) -> mujoco.MjModel:
        """The nominal model, without contacts, limits and what is accounted for joint by joint."""
        return self._model

    @property
    def nominal(self) -> Array:
        """Torque of the nominal model and what is given, (T, m) [N, N·m], filtered."""
        if self._nominal is None:
            self._nominal = self.of(())
        return self._nominal

    @property
    def frictionless(self) -> Array:
        """The same without dry friction, (T, m) [N, N·m], filtered."""
        return self.nominal - self.course.filtered(self._rubbing(*self._at_work((), self.nominal)))

    @property
    def along(self) -> Now:
        """What a declaration sees of the nominal model along the measured motion."""
        return Now(_Host(self._model, self.motion, self.wiring, self._joint, None), self.wiring, _no_chance)

    def of(self, entries: Sequence[Entry], effort: Array | None = None) -> Array:
        """Torque with effects, (T, m) [N, N·m], filtered.

        Args:
            entries: effects and their parameters, of :data:`STAGES`.
            effort: (T, m) torque that the drives transmit, for effects that depend on it; None: as without them.

        Raises:
            OutOfTimeError: the deadline is over.
        """
        self.deadline.check()
        host, now, effects = self._at_work(entries, effort)
        for effect in effects:
            if overrides(effect, "measure_position"):
                host.motion = _true_motion(effect, host.motion, now)
        rigid = self._rigid_torque(entries)
        found = rigid + self.course.filtered(self._drive(host, now, effects))
        if not host.asked or effort is not None:
            return found
        # Friction by load is part of the load: a fixed point, of which each round is nearer by the friction's share.
        for _ in range(MAX_LOAD_ROUNDS):
            before = host.effort = found
            found = rigid + self.course.filtered(self._drive(host, now, effects))
            if np.abs(found - before).max() <= LOAD_SETTLED * np.abs(found).max():
                break
        return found

    def _drive(self, host: _Host, now: Now, effects: Sequence[Effect]) -> Array:
        """What drives need for friction, damping and their own inertia, (T, m) [N, N·m]."""
        damping, force = host.joint["dof_damping"], np.zeros_like(host.motion[0])
        for effect in effects:
            if overrides(effect, "added_damping"):
                damping = np.where(effect.present, damping + effect.added_damping(now), damping)
            if overrides(effect, "added_force"):
                force = np.where(effect.reach, force + effect.added_force(now), force)
        _, velocity, acceleration = host.motion
        drive = np.maximum(damping, 0) * velocity + host.joint["dof_armature"] * acceleration - force
        return drive + self._rubbing(host, now, effects)

    def _rigid_torque(self, entries: Sequence[Entry]) -> Array:
        """Gravity, inertia and springs, (T, m) [N, N·m], filtered: what entries change of them, added up.

        Torques are linear in masses and inertias, so that those of several bodies add up exactly; where readings of
        positions are wrong, or gravity leans, as well, what both change together is of second order.
        """
        total = self._kept_torque(())
        for entry in entries:
            if self._changes_rigid(entry):
                total = total + self._changed_by(entry)
        return total

    def _changed_by(self, entry: Entry) -> Array:
        """What one effect changes, (T, m) [N, N·m]: in proportion to its strength as far as that was seen to hold."""
        strength, unit = _strength(entry)
        whole = self._kept_torque((unit,)) - self._kept_torque(())
        half = self._kept_torque((_scaled(unit, 0.5),)) - self._kept_torque(())
        error = float(np.abs(half - 0.5 * whole).max()) / max(float(np.abs(whole).max()), 1e-12)
        if error < EXACTLY or (error < LINEAR and abs(strength) <= 1):
            return strength * whole
        return self._kept_torque((entry,)) - self._kept_torque(())

    def _kept_torque(self, entries: tuple[Entry, ...]) -> Array:
        """Inverse dynamics with some effects, (T, m) [N, N·m], filtered, computed once."""
        if entries not in self._kept:
            if len(self._kept) >= KEPT:
                self._kept.clear()
            host, now, effects = self._at_work(entries, None)
            motion = self.motion
            for effect in effects:
                if overrides(effect, "measure_position"):
                    motion = _true_motion(effect, motion, now)
            if now.rebuild:
                mujoco.mj_setConst(host.model, mujoco.MjData(host.model))
            for name in JOINT_FIELDS:
                getattr(host.model, name)[:] = 0.0
            self._kept[entries] = self.course.filtered(self._inverse(host.model, motion))
        return self._kept[entries]

    def _changes_rigid(self, entry: Entry) -> bool:
        """Whether an effect changes more than friction, damping and reflected inertia."""
        key = (entry.name, entry.target)
        if key not in self._rigid:
            host = _Host(self._model, self.motion, self.wiring, self._joint, None)
            effect = arrays(EFFECTS[entry.name], [[Entry(entry.name, entry.target)]], self.wiring.targets)
            effect.change(Now(host, self.wiring, _no_chance))
            self._rigid[key] = host.rigid_changed or overrides(effect, "measure_position")
        return self._rigid[key]

    def by(self, deadline: Deadline) -> Torques:
        """The same, with another deadline; what is remembered is shared."""
        other = copy.copy(self)
        other.deadline = deadline
        return other

    def with_noise(self, rng: np.random.Generator) -> Torques:
        """Along the same motion with one more draw of the positions' noise."""
        other = copy.copy(self)
        added = self.course.noise_of_motion(rng)
        other.motion = tuple(one + noise for one, noise in zip(self.motion, added, strict=True))
        other._nominal, other._kept = None, {}
        return other

    def _at_work(self, entries: Sequence[Entry], effort: Array | None) -> tuple[_Host, Now, list[Effect]]:
        """Effects whose changes are made to the host's copy of the model."""
        host = _Host(self._model, self.motion, self.wiring, self._joint, effort)
        now, effects = Now(host, self.wiring, _no_chance), []
        entries = (*self._given, *entries)
        for name in dict.fromkeys(entry.name for entry in entries):
            effects.append(arrays(EFFECTS[name], [[e for e in entries if e.name == name]], self.wiring.targets))
            effects[-1].change(now)
        return host, now, effects

    def _rubbing(self, host: _Host, now: Now, effects: Sequence[Effect]) -> Array:
        """What drives need for dry friction, (T, m) [N, N·m]."""
        friction = host.joint["dof_frictionloss"]
        for effect in effects:
            if overrides(effect, "added_friction"):
                friction = np.where(effect.present, friction + effect.added_friction(now), friction)
        return np.maximum(friction, 0.0) * np.clip(host.motion[1] / self.course.rest_speed, -1, 1)

    def _inverse(self, model: mujoco.MjModel, motion: tuple[Array, ...]) -> Array:
        """Inverse dynamics, (T, m)."""
        self.deadline.check()
        data = mujoco.MjData(model)
        rest = model.key_qpos[0] if model.nkey else data.qpos
        q, v, a = (np.zeros((len(motion[0]), n)) for n in (model.nq, model.nv, model.nv))
        q[:] = rest
        q[:, self.wiring.qpos], v[:, self.wiring.dof], a[:, self.wiring.dof] = motion
        needed = np.empty_like(v)
        qpos, qvel, qacc, torque = data.qpos, data.qvel, data.qacc, data.qfrc_inverse
        for t in range(len(q)):
            qpos[:], qvel[:], qacc[:] = q[t], v[t], a[t]
            mujoco.mj_inverse(model, data)
            needed[t] = torque
        return needed[:, self.wiring.dof]


class _Host:
    """Rows of a motion as simulations: states and efforts (T, ...); model fields (1, ...) of a copy."""

    nsim = 1
    simulates = False

    def __init__(
        self,
        model: mujoco.MjModel,
        motion: tuple[Array, ...],
        wiring: Wiring,
        joint: Mapping[str, Array],
        effort: Array | None,
    ) -> None:
        self.model = copy.copy(model)
        self.motion = motion
        self._wiring, self.effort = wiring, effort
        self._fields: dict[str, Array] = {}
        self.asked = False
        for name, values in joint.items():
            getattr(self.model, name)[wiring.dof] = values

    def field(self, name: str) -> Array:
        value = getattr(self.model.opt, name[4:]) if name.startswith("opt.") else getattr(self.model, name)
        if name not in self._fields:
            self._fields[name] = np.array(value)
        view: Array = value[None]
        return view

    @property
    def joint(self) -> dict[str, Array]:
        """Friction, damping and armature of the joints, (1, m)."""
        return {name: getattr(self.model, name)[None, self._wiring.dof].copy() for name in JOINT_FIELDS}

    @property
    def rigid_changed(self) -> bool:
        """Whether a field was changed that inverse dynamics heeds."""
        local = (*JOINT_FIELDS, "dof_solimp", "dof_solref")
        return any(
            not np.array_equal(before, self.field(name)[0])
            for name, before in self._fields.items()
            if name not in local and not name.startswith("actuator_")
        )

    def state(self, name: str) -> Array:
        if name not in ("qpos", "qvel"):
            raise KeyError(f"a recorded motion has no {name}")
        where = self._wiring.qpos if name == "qpos" else self._wiring.dof
        return self._wide(self.motion[0 if name == "qpos" else 1], where, self.model.nq if name == "qpos" else None)

    def output(self, name: str) -> Array:
        if name not in ("qfrc_actuator", "qfrc_smooth"):  # the latter pushes a joint at rest: what its drive transmits
            raise KeyError(f"a recorded motion has no {name}")
        self.asked = True
        return self._wide(np.zeros_like(self.motion[0]) if self.effort is None else self.effort, self._wiring.dof)

    def set_timestep(self, seconds: Array) -> None:
        raise KeyError("a recorded motion has no time step")

    def step(self, count: int) -> None:
        raise KeyError("a recorded motion is not simulated")

    def forward(self) -> None:
        raise KeyError("a recorded motion is not simulated")

    def set_const(self) -> None:
        mujoco.mj_setConst(self.model, mujoco.MjData(self.model))

    def models(self) -> Iterator[mujoco.MjModel]:
        yield self.model

    def _wide(self, values: Array, where: NDArray[np.intp], width: int | None = None) -> Array:
        wide = np.zeros((len(values), width or self.model.nv))
        wide[:, where] = values
        return wide


def _strength(entry: Entry) -> tuple[float, Entry]:
    """Strength of an effect in units of its default, and the effect at that."""
    declared = EFFECTS[entry.name]
    first = next(p for p in declared.parameters.values() if p.identity is not None)
    identity = float(first.identity or 0.0)
    size = first.default[1] - identity
    given = float(entry.parameters.get(first.name, first.default[1]))
    unit = replace(entry, parameters={**entry.parameters, first.name: first.default[1]})
    return (given - identity) / size, unit


def _scaled(unit: Entry, share: float) -> Entry:
    """An effect at its default, at a share of it."""
    first = next(p for p in EFFECTS[unit.name].parameters.values() if p.identity is not None)
    identity = float(first.identity or 0.0)
    return replace(unit, parameters={**unit.parameters, first.name: identity + share * (first.default[1] - identity)})


def invertible(effect: Effect, position: Array, now: Now) -> bool:
    """Whether the true positions follow from the measured ones: the reading rises smoothly with the position."""
    step = 1e-6
    slope = (effect.measure_position(position + step, now) - effect.measure_position(position, now)) / step
    return bool((np.abs(slope - 1) < 0.5).all())


def _true_motion(effect: Effect, measured: tuple[Array, ...], now: Now) -> tuple[Array, ...]:
    """The motion behind readings that are wrong, by fixed-point iteration."""
    position, velocity, acceleration = measured
    true = position
    for _ in range(50):
        error = position - effect.measure_position(true, now)
        true = true + error
        if np.abs(error).max() < 1e-10:
            break
    step = 1e-6
    slope = (effect.measure_position(true + step, now) - effect.measure_position(true, now)) / step
    return true, velocity / slope, acceleration / slope


def _wiring(model: mujoco.MjModel, joints: Sequence[str]) -> Wiring:
    there = [model.joint(j).name for j in range(model.njnt)]
    for name in joints:
        if name not in there:
            raise ValueError(
                f"the model has no joint {name!r}: it has {', '.join(there)}; rename it or give a map file"
            )
    ids = {model.joint(name).id for name in joints}
    actuators = [
        model.actuator(a).name
        for a in range(model.nu)
        if model.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_JOINT and int(model.actuator_trnid[a, 0]) in ids
    ]
    return wire(model, joints=joints, actuators=actuators)


def _no_chance(shape: tuple[int, ...]) -> Array:
    raise ValueError("inverse dynamics draws no random numbers")
