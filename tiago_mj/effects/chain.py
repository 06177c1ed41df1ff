"""Effects at work on one or many simulations: command → servo → joints → sensors.

A chain holds what effects are and do; :mod:`tiago_mj.effects.runner` steps the simulations. Every array has a leading
axis of simulations, and each simulation has its own parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.contact import renew_contacts
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

    Attributes:
        now: what hooks know.
        effects: those that are present in some simulation, in the order in which they act.

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
        self._nominal: dict[str, Array] = {}
        self._masks = {effect.name: effect.reach for effect in self.effects}
        self._hooks = {hook: self._users(hook) for hook in (*EACH_SUBSTEP, *EACH_STEP)}
        self._timestep = float(host.model.opt.timestep)

    @classmethod
    def unsimulated(
        cls,
        model: mujoco.MjModel,
        wiring: Wiring,
        sims: Sequence[Sequence[Entry]],
        uniform: Callable[[tuple[int, ...]], Array],
    ) -> Chain:
        """Effects without a simulation, for what they make of commands or of readings that are there already.

        Args:
            model: nominal.
            wiring, sims, uniform: see the class.
        """
        host: Any = _NoSimulation(model, len(sims))
        return cls(host, wiring, sims, uniform)

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

    def change(self, period: float, substeps: int, contact: tuple[float, float, int] | None = None) -> None:
        """Apply the effects to the nominal model and the initial state, which must be set.

        Args:
            period: nominal control period [s].
            substeps: physics steps in it.
            contact: stiffness [N/m], damping [N·s/m] and contact points of one pad with the object.
        """
        self.restore()
        now = self.now
        now.contact = contact
        now.step, now.substeps, now.rebuild = 0, substeps, False
        now.elapsed = np.zeros(self._host.nsim)
        now.dt, now.clock = np.full(self._host.nsim, period), np.ones(self._host.nsim)
        if not self.effects:
            return
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
            renew_contacts(now, touched, factors)

    def begin(self) -> None:
        """Forget the episode before: call it once the set points are known, as :attr:`now` has them."""
        for effect in self.effects:
            effect.start(self.now)

    def kept(self, name: str) -> Array:
        """A field of the model that is going to be changed, and is given back by :meth:`restore`."""
        return _Recording(self._host, self._nominal).field(name)

    @property
    def asked(self) -> tuple[str, ...]:
        """Fields of the model that effects asked for, to change them or to know them, since :meth:`change`."""
        return tuple(self._nominal)

    # Commands -------------------------------------------------------------------------------------------------------

    def command(self, command: Array) -> Array:
        """What arrives of a command, (nsim, nactuators) in the interface's unit."""
        return self._through("command", command)

    def set_point(self, target: Array) -> Array:
        """What the servos take for the set points that they are given, (nsim, nactuators) [m, rad]."""
        return self._through("set_point", target)

    # Reading --------------------------------------------------------------------------------------------------------

    @property
    def passes_readings(self) -> bool:
        """Whether what is measured is what is simulated: no effect of a sensor is there."""
        return not any(self._hooks[hook] for hook in READINGS)

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

    # Hooks ----------------------------------------------------------------------------------------------------------

    def users(self, hook: str) -> list[tuple[Effect, NDArray[np.bool_]]]:
        """Effects that have a hook of every step, and where each is present: (nsim, ntargets of the hook)."""
        return self._hooks[hook]

    def where(self, hook: str) -> NDArray[np.bool_] | None:
        """Where some effect has a hook, (nsim, ntargets of the hook); None: nowhere."""
        masks = [mask for _, mask in self._hooks[hook]]
        if not masks:
            return None
        moved: NDArray[np.bool_] = np.logical_or.reduce(masks)
        return moved

    def _through(self, hook: str, value: Array) -> Array:
        for effect, mask in self._hooks[hook]:
            value = np.where(mask, getattr(effect, hook)(value, self.now), value)
        return value

    def _users(self, hook: str) -> list[tuple[Effect, NDArray[np.bool_]]]:
        actuated = hook in ("set_point", "given", "servo_force", "force_range")
        return [(e, self._of_actuators(e) if actuated else self._masks[e.name]) for e in self.effects if acts(e, hook)]

    def _of_actuators(self, effect: Effect) -> NDArray[np.bool_]:
        """Where an effect on commands or joints is present, (nsim, nactuators)."""
        mask = self._masks[effect.name]
        return mask[:, list(self._wiring.targets.actuated)] if effect.targets == "joint" else mask


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


class _NoSimulation:
    """A host that can neither be stepped nor changed."""

    def __init__(self, model: mujoco.MjModel, nsim: int) -> None:
        self.model, self.nsim = model, nsim
