"""The signal chain of one or many simulations with effects in it: command → servo → joints → sensors.

The environments run one simulation through it, the diagnosis runs hundreds at once, by the same code: every array has a
leading axis of simulations, and each simulation has its own parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.declare import EFFECTS, STAGES, Effect, overrides
from tiago_mj.effects.host import Host
from tiago_mj.effects.now import Now, Wiring
from tiago_mj.effects.spec import Entry, arrays

Array = NDArray[np.float64]

__all__ = ["Chain", "Now", "Wiring", "acts"]

#: Hooks that act in every physics step, and in every control step.
EACH_SUBSTEP: Final = ("added_friction", "added_damping", "added_force", "servo_force", "force_range")
EACH_STEP: Final = (
    "command",
    "set_point",
    "given",
    "measure_position",
    "true_position",
    "measure_velocity",
    "contact_force",
    "reading",
    "noise",
    "sample",
)


#: And of those what stands between a simulation and its recording.
READINGS: Final = ("measure_position", "measure_velocity", "contact_force", "reading", "noise", "sample")


class Chain:
    """Effects at work on the simulations of a host.

    Args:
        host: the simulations.
        wiring: their parts.
        sims: entries of every simulation.
        uniform: draws uniform numbers of a shape whose first axis is the simulations.

    Raises:
        ValueError: an entry names a target that the plant does not have.
    """

    def __init__(
        self,
        host: Host,
        wiring: Wiring,
        sims: Sequence[Sequence[Entry]],
        uniform: Callable[[tuple[int, ...]], Array],
    ) -> None:
        if len(sims) != host.nsim:
            raise ValueError(f"{len(sims)} lists of effects for {host.nsim} simulations: give one each")
        self.now = Now(host, wiring, uniform)
        wanted = {entry.name for entries in sims for entry in entries}
        order = sorted((name for name in EFFECTS if name in wanted), key=lambda name: STAGES.index(EFFECTS[name].stage))
        effects = [arrays(EFFECTS[name], sims, wiring.targets) for name in order]
        self.effects = [effect for effect in effects if effect.present.any()]  # the others draw no random numbers
        self._host, self._wiring = host, wiring
        self._stateful = wiring.act >= 0
        self._all_stateful = bool(self._stateful.all())
        self._nominal: dict[str, Array] = {}
        self._masks = {effect.name: effect.present for effect in self.effects}
        self._hooks = {hook: self._users(hook) for hook in (*EACH_SUBSTEP, *EACH_STEP)}
        self._moves_set_point = self._any("set_point")
        self._on_its_way = self._any("given")
        self._per_substep = any(self._hooks[hook] for hook in EACH_SUBSTEP)
        if self._per_substep:
            for name in ("qfrc_actuator", "qfrc_smooth", "actuator_force"):
                host.output(name)  # a batch fills what is asked for at its next call: ask before the first
        self._timestep = float(host.model.opt.timestep)
        self._base_friction: Any = None
        self._base_damping: Any = None
        self._base_range: Any = None
        self._limits_force, self._adds_force = bool(self._hooks["force_range"]), bool(self._hooks["servo_force"])
        self._base_bias: Any = None

    # Reset ----------------------------------------------------------------------------------------------------------

    def restore(self) -> None:
        """Give every changed field its nominal value back: call it before the nominal model is changed."""
        for name, value in self._nominal.items():
            self._host.field(name)[:] = value
        if self._nominal and self.now.rebuild:
            self._host.set_const()
        self._nominal.clear()
        if (self.now.clock != 1).any():
            self._host.set_timestep(np.full(self._host.nsim, self._timestep))

    def start(
        self,
        period: float,
        substeps: int,
        contact: tuple[float, float, int] | None = None,
        held: Array | None = None,
    ) -> None:
        """Apply the effects to the nominal model and the initial state, which must be set, and forget what was.

        Args:
            period: nominal control period [s].
            substeps: physics steps in it.
            contact: stiffness [N/m], damping [N·s/m] and contact points of one pad with the object.
            held: set points of plain position servos before the first command, (nsim, nactuators) [m, rad]; None: where
                the joints are.
        """
        self.restore()
        now = self.now
        now.contact = contact
        now.step, now.substeps, now.rebuild = 0, substeps, False
        now.elapsed = np.zeros(self._host.nsim)
        now.dt, now.clock = np.full(self._host.nsim, period), np.ones(self._host.nsim)
        self._substeps = substeps
        recording = _Recording(self._host, self._nominal)
        now.host = recording  # remembers what is changed
        try:
            heavier = np.zeros(now.nsim, dtype=bool)
            for effect in self.effects:
                rebuilt, now.rebuild = now.rebuild, False
                effect.change(now)
                if now.rebuild:
                    heavier |= self._masks[effect.name].any(axis=1)
                now.rebuild |= rebuilt
            if now.rebuild:
                recording.set_const()
            self._renew_contacts(heavier)
        finally:
            now.host = self._host
        for effect in self.effects:
            effect.place(now)
        if (now.clock != 1).any():
            now.dt = now.dt * now.clock
            # Where the period is whole steps of the model's, these to the last bit; else that which the host was given.
            step = self._timestep if np.isclose(substeps * self._timestep, period, rtol=1e-9) else period / substeps
            self._host.set_timestep(np.where(now.clock == 1, step, now.dt / substeps))
        if self._per_substep:
            wiring = self._wiring
            self._base_friction = recording.field("dof_frictionloss")[:, wiring.dof].copy()
            self._base_damping = recording.field("dof_damping")[:, wiring.dof].copy()
            if self._adds_force:
                self._base_bias = recording.field("actuator_biasprm")[:, wiring.actuators, 0].copy()
            if self._limits_force:
                self._base_range = recording.field("actuator_forcerange")[:, wiring.actuators].copy()
        here = self.now.joint_position[:, list(self._wiring.targets.actuated)]
        self._plain = here if held is None else np.array(held)
        self._foreseen: Array | None = None
        self._target = self.set_points()
        self._shift = np.zeros_like(self._target)
        if self._wiring.ideal:
            self._measure_slack()
        now.set_point = self._target.copy()
        now.idle = self._target.copy() if self._wiring.interface == "position" else np.zeros_like(self._target)
        now.takes_set_points = self._takes_set_points()
        self._plain_servos = bool(now.takes_set_points.any())
        # A plain position servo takes what it is given at once, as it does in MuJoCo.
        self._speed_limit = np.where(now.takes_set_points, np.inf, self._wiring.targets.velocity)
        now.resting = np.where(now.takes_set_points, self._plain, 0.0)
        self._coming = self._target.copy()
        for effect in self.effects:
            effect.start(now)

    def _renew_contacts(self, touched: NDArray[np.bool_]) -> None:
        """Stiffness and damping of pad and object follow masses that an effect changed, and effects that scale them."""
        now = self.now
        if now.contact is None:
            return
        factors = np.ones((now.nsim, 3))
        for effect, mask in self._users("contact_factors"):
            factors = np.where(mask, effect.contact_factors(factors, now), factors)
            touched = touched | mask.any(axis=1)
        if touched.any():
            from tiago_mj.effects.contact import renew_contacts

            renew_contacts(now, touched, factors)

    @property
    def asked(self) -> tuple[str, ...]:
        """Fields of the model that effects asked for, to change them or to know them, since :meth:`start`."""
        return tuple(self._nominal)

    # A control step -------------------------------------------------------------------------------------------------

    def set_points(self) -> Array:
        """The servos' set points, (nsim, nactuators) [m, rad]; the joint's first position where there is no servo."""
        wiring, stateful = self._wiring, self._stateful
        if self._foreseen is not None:
            return np.where(stateful, self._foreseen, self._plain)
        if self._all_stateful:
            return self._host.state("act")[:, wiring.act]
        plain = self._plain.copy()
        plain[:, stateful] = self._host.state("act")[:, wiring.act[stateful]]
        return plain

    def advance(
        self,
        command: Array,
        seconds: Array | None = None,
        parts: int = 1,
        between: Callable[[int], None] = lambda part: None,
    ) -> None:
        """Let the commands act for one control period.

        Args:
            command: (nsim, nactuators) in the interface's unit.
            seconds: length of this period by the recorder's clock, (nsim,) [s], where it is not the nominal one.
            parts: of the period, of whole physics steps each.
            between: told the number of each part but the last, from 1, once it is simulated.
        """
        now, wiring = self.now, self._wiring
        if seconds is not None:
            now.dt = seconds * now.clock
            self._host.set_timestep(now.dt / self._substeps)
        if wiring.ideal:
            self._hold_set_points()
        self._run(self._commanded(command), parts, between)
        now.step += 1
        now.elapsed = now.elapsed + now.dt

    def _commanded(self, command: Array) -> Array:
        """Inputs of the servos for a command, (nsim, nactuators), before what delays them on their way."""
        now, wiring = self.now, self._wiring
        command = self._through("command", command)
        if wiring.interface == "effort":
            ctrl = command
        else:
            present = self._ahead()
            if wiring.interface == "velocity":
                wanted = self._target + command * now.period
                ctrl, reached = command, present + command * now.period
            else:
                wanted = command
                ctrl, reached = _towards(command, present, now.period, self._speed_limit)
            low, high = wiring.span.T
            self._target = _within(wanted, low - self._shift, high - self._shift)
            if self._moves_set_point is not None:
                effective = self.set_point(self._target) + self._shift
                moved, there = _towards(effective, present, now.period, self._speed_limit)
                ctrl = np.where(self._moves_set_point, moved, ctrl)
                reached = np.where(self._moves_set_point, there, reached)
            self._coming = _within(reached, low, high)
            if self._plain_servos:
                self._plain = np.where(now.takes_set_points, self._coming, self._plain)
                ctrl = np.where(now.takes_set_points, self._plain, ctrl)
        return ctrl

    @property
    def open_loop(self) -> bool:
        """Whether what the servos are given depends on commands alone, so that a run needs no one between its steps.

        Set points that an actuator integrates (``act``) depend on what it is given alone, too: they are foreseen.
        """
        wiring = self._wiring
        stateful = wiring.act >= 0
        integrates = self._host.model.actuator_dyntype[wiring.actuators] == mujoco.mjtDyn.mjDYN_INTEGRATOR
        if wiring.ideal or (stateful & ~integrates).any():
            return False
        return all(effect.signal_only for hook in (*EACH_SUBSTEP, *EACH_STEP) for effect, _ in self._hooks[hook])

    def ahead(self, commands: Array) -> Array:
        """Inputs that an open loop gives the servos in each physics step of the next commands, (nsim, rows,
        nactuators) to (nsim, rows * nsubsteps, nactuators)."""
        if self._passes_commands:
            plain = self.now.takes_set_points
            each = np.where(plain, np.clip(commands, *self._wiring.span.T), commands) if plain.any() else commands
            self.now.step += commands.shape[1]
            self.now.elapsed = self.now.elapsed + commands.shape[1] * self.now.dt
        else:
            return self._foreseeing(commands)
        inputs = np.repeat(each, self._substeps, axis=1)
        for effect, mask in self._hooks["given"]:
            inputs = np.where(mask[:, None], effect.given(inputs, self.now), inputs)
        return inputs

    def _foreseeing(self, commands: Array) -> Array:
        """The same where a command meets what was commanded before: set points are followed without the simulation."""
        now, rows = self.now, []
        self._foreseen = self.set_points()
        for k in range(commands.shape[1]):
            arriving = self._arriving(self._commanded(commands[:, k]))
            rows.append(arriving)
            self._foreseen = self._integrated(self._foreseen, arriving)
            now.step += 1
            now.elapsed = now.elapsed + now.dt
        self._foreseen = None
        return np.concatenate(rows, axis=1)

    def _integrated(self, set_points: Array, inputs: Array) -> Array:
        """Set points that actuators integrate, after physics steps with these inputs, (nsim, nsteps, nactuators); as
        MuJoCo's Euler steps of ``act``, within ``actrange``."""
        ids, model = self._wiring.actuators, self._host.model
        slowest, fastest = np.moveaxis(self._host.field("actuator_ctrlrange")[:, None, ids], -1, 0)
        speeds = np.where(model.actuator_ctrllimited[ids], np.clip(inputs, slowest, fastest), inputs)
        limited, ends = model.actuator_actlimited[ids], self._host.field("actuator_actrange")[:, ids]
        low, high = np.where(limited, ends[..., 0], -np.inf), np.where(limited, ends[..., 1], np.inf)
        step = self.now.dt[:, None] / self._substeps
        for k in range(inputs.shape[1]):
            set_points = np.clip(set_points + speeds[:, k] * step, low, high)
        return set_points

    @property
    def _passes_commands(self) -> bool:
        """Whether each command of an open loop is what the servos are given, whatever was commanded before."""
        wiring = self._wiring
        moved = self.now.takes_set_points.any() and wiring.interface == "velocity"
        followed = (wiring.act >= 0).any() and wiring.interface == "position"
        return not (moved or followed or self._hooks["command"] or self._hooks["set_point"])

    @property
    def passes_readings(self) -> bool:
        """Whether what is measured is what is simulated: no effect of a sensor is there."""
        return not any(self._hooks[hook] for hook in READINGS)

    def _hold_set_points(self) -> None:
        """An ideal servo has no set point to run away: what the effort limit cannot hold is forgotten."""
        wiring = self._wiring
        joints = list(wiring.targets.actuated)
        joint = self.now.joint_position[:, joints] + self._lag * self.now.joint_velocity[:, joints]
        present = self.set_points()
        held = np.minimum(np.maximum(present, joint - self._slack), joint + self._slack)
        self._host.state("act")[:, wiring.act] = held
        self._coming = self._coming + (held - present)
        if wiring.interface == "velocity":
            # Commands and what effects remember of them stay in a frame of their own, which the forgetting moves.
            self._shift = self._shift + (held - present)

    def _measure_slack(self) -> None:
        """How far an ideal servo's set point may lead, and its lag [m, rad], [s]; of each simulation's own servo."""
        ids, host = self._wiring.actuators, self._host
        stiffness = host.field("actuator_gainprm")[:, ids, 0]
        self._slack = host.field("actuator_forcerange")[:, ids, 1] / stiffness
        self._lag = -host.field("actuator_biasprm")[:, ids, 2] / stiffness

    def _ahead(self) -> Array:
        """Where set points will be once all that is on its way has arrived, (nsim, nactuators) [m, rad]."""
        present = self.set_points()
        return present if self._on_its_way is None else np.where(self._on_its_way, self._coming, present)

    def _takes_set_points(self) -> NDArray[np.bool_]:
        """Which actuators are plain position servos, (nactuators,)."""
        wiring = self._wiring
        return wiring.servo & (wiring.act < 0) & (wiring.interface != "effort")

    def _run(self, inputs: Array, parts: int, between: Callable[[int], None]) -> None:
        """Physics steps of a control period, with what is held for all of it or what arrives in each."""
        ctrl, steps = self._host.state("ctrl"), self._substeps // parts
        if self._on_its_way is None:
            ctrl[:, self._wiring.ctrl] = inputs
            if not self._per_substep:
                for part in range(1, parts):
                    self._host.step(steps)
                    between(part)
                self._host.step(steps)
                return
            arriving = None
        else:
            arriving = self._arriving(inputs)
        for k in range(self._substeps):
            if k and k % steps == 0:
                between(k // steps)
            if arriving is not None:
                ctrl[:, self._wiring.ctrl] = arriving[:, k]
            if self._per_substep:
                self._physics_step()
            else:
                self._host.step(1)

    def _arriving(self, inputs: Array) -> Array:
        """What the servos are given in each physics step, (nsim, nsubsteps, nactuators)."""
        value = np.repeat(inputs[:, None], self._substeps, axis=1)
        for effect, mask in self._hooks["given"]:
            value = np.where(mask[:, None], effect.given(value, self.now), value)
        return value

    def _physics_step(self) -> None:
        now, host, dof = self.now, self._host, self._wiring.dof
        if self._hooks["added_friction"]:
            friction = self._base_friction
            for effect, mask in self._hooks["added_friction"]:
                friction = np.where(mask, friction + effect.added_friction(now), friction)
            host.field("dof_frictionloss")[:, dof] = np.maximum(friction, 0.0)
        if self._hooks["added_damping"]:
            damping = self._base_damping
            for effect, mask in self._hooks["added_damping"]:
                damping = np.where(mask, damping + effect.added_damping(now), damping)
            host.field("dof_damping")[:, dof] = np.maximum(damping, 0.0)
        if self._hooks["added_force"]:
            force = np.zeros((now.nsim, len(dof)))
            for effect, mask in self._hooks["added_force"]:
                force = np.where(mask, force + effect.added_force(now), force)
            host.state("qfrc_applied")[:, dof] = force
        if self._adds_force:
            own = self._base_bias
            for effect, mask in self._hooks["servo_force"]:
                own = np.where(mask, own + effect.servo_force(now), own)
            host.field("actuator_biasprm")[:, self._wiring.actuators, 0] = own
        if self._limits_force:
            limits = self._base_range
            for effect, mask in self._hooks["force_range"]:
                limits = np.where(mask[:, :, None], effect.force_range(limits, now), limits)
            host.field("actuator_forcerange")[:, self._wiring.actuators] = limits
        host.step(1)

    def set_point(self, target: Array) -> Array:
        """What the servos take for the set points that they are given, (nsim, nactuators) [m, rad]."""
        return self._through("set_point", target)

    # Reading --------------------------------------------------------------------------------------------------------

    def position(self, position: Array) -> Array:
        """As measured, (nsim, njoints)."""
        return self._through("measure_position", position)

    def true_position(self, measured: Array) -> Array:
        """Where joints are that were measured at rest, (nsim, njoints); the last effect on the way is undone first."""
        for effect, mask in reversed(self._hooks["true_position"]):
            measured = np.where(mask, effect.true_position(measured, self.now), measured)
        return measured

    def velocity(self, velocity: Array) -> Array:
        """As measured, (nsim, njoints)."""
        return self._through("measure_velocity", velocity)

    def reading(self, newtons: Array, units_per_newton: Callable[[Array], Array], noise: Array) -> Array:
        """Load-cell samples, (nsim, nsensors), of newtons on the pads and noise [sensor units]."""
        return self._through("sample", self.before_sampling(newtons, units_per_newton) + self._through("noise", noise))

    def before_sampling(self, newtons: Array, units_per_newton: Callable[[Array], Array]) -> Array:
        """What is sampled of the load cells, free of noise, (nsim, nsensors) [sensor units]."""
        return self._through("reading", units_per_newton(self._through("contact_force", newtons)))

    def _through(self, hook: str, value: Array) -> Array:
        for effect, mask in self._hooks[hook]:
            value = np.where(mask, getattr(effect, hook)(value, self.now), value)
        return value

    def _users(self, hook: str) -> list[tuple[Effect, NDArray[np.bool_]]]:
        """Effects that have a hook, and where each is present."""
        actuated = hook in ("set_point", "given", "servo_force", "force_range")
        return [(e, self._of_actuators(e) if actuated else self._masks[e.name]) for e in self.effects if acts(e, hook)]

    def _of_actuators(self, effect: Effect) -> NDArray[np.bool_]:
        """Where an effect on commands or joints is present, (nsim, nactuators)."""
        mask = self._masks[effect.name]
        return mask[:, list(self._wiring.targets.actuated)] if effect.targets == "joint" else mask

    def _any(self, hook: str) -> NDArray[np.bool_] | None:
        masks = [mask for _, mask in self._hooks[hook]]
        if not masks:
            return None
        moved: NDArray[np.bool_] = np.logical_or.reduce(masks)
        return moved


def acts(effect: Effect, hook: str) -> bool:
    """Whether an effect has a hook that does something in some simulation."""
    given = effect.by_detail.get(hook)
    return overrides(effect, hook) and (given is None or bool(getattr(effect, given).any()))


class _Recording:
    """A host that remembers the nominal value of every field that is asked for."""

    def __init__(self, host: Host, nominal: dict[str, Array]) -> None:
        self._host, self._nominal = host, nominal
        self.nsim, self.model = host.nsim, host.model

    def field(self, name: str) -> Array:
        field = self._host.field(name)
        if name not in self._nominal:
            self._nominal[name] = field.copy()
        return field

    def __getattr__(self, name: str) -> Any:
        return getattr(self._host, name)


def _towards(target: Array, present: Array, period: Array, limit: Array) -> tuple[Array, Array]:
    """Speed that reaches the target within a control period, or the limit; and what it reaches."""
    speed = _within((target - present) / period, -limit, limit)
    return speed, np.where(np.isfinite(limit), present + speed * period, target)


def _within(values: Array, low: Array, high: Array) -> Array:
    """As np.clip, which is a Python function around another."""
    return np.minimum(np.maximum(values, low), high)
