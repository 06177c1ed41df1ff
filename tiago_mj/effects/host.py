"""One interface to one simulation (an environment's MjModel and MjData) and to many (a mujoco.Batch)."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final, Protocol

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Where an array has what belongs together.
Span = slice | NDArray[np.intp]


def span(addresses: Sequence[int]) -> Span:
    """A slice where the addresses are consecutive (no copy, a third of the time), else an index array."""
    first = addresses[0] if addresses else 0
    if list(addresses) == list(range(first, first + len(addresses))) and first >= 0:
        return slice(first, first + len(addresses))
    return np.array(addresses, dtype=np.intp)


class Host(Protocol):
    """Simulations whose fields are arrays with a leading axis of simulations."""

    nsim: int
    #: Whether it steps; else motions are given, and torques are asked for.
    simulates: bool

    @property
    def model(self) -> mujoco.MjModel:
        """That all are of."""

    def field(self, name: str) -> Array:
        """A model field, (nsim, ...), writable; ``opt.gravity`` and the like, too."""

    def state(self, name: str) -> Array:
        """A state field such as ``qpos`` or ``ctrl``, (nsim, ...), writable."""

    def output(self, name: str) -> Array:
        """A derived field such as ``sensordata``, (nsim, ...), as of the last physics step."""

    def set_timestep(self, seconds: Array) -> None:
        """Physics step of every simulation, (nsim,) [s]."""

    def step(self, count: int) -> None:
        """Advance by so many physics steps."""

    def forward(self) -> None:
        """Compute derived fields at the present state."""

    def set_const(self) -> None:
        """Recompute the constants that follow from masses and inertias."""

    def models(self) -> Iterator[mujoco.MjModel]:
        """Each simulation's model in turn, with what was changed; the next one may overwrite it."""


class Watched(Host, Protocol):
    """Simulations that say which of them go on."""

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Those that MuJoCo has given up, (nsim,): what follows is no motion."""


class ScalarHost:
    """One model and its data, as views: what is written is the simulation's own."""

    nsim = 1
    simulates = True

    def __init__(self, data: mujoco.MjData) -> None:
        self._data = data
        self.model: mujoco.MjModel = data.model
        self._states: dict[str, Array] = {}

    def __getstate__(self) -> mujoco.MjData:
        """The data alone: a copy of it has a model of its own, and its memory is elsewhere."""
        return self._data

    def __setstate__(self, data: mujoco.MjData) -> None:
        self.__init__(data)  # type: ignore[misc]

    def field(self, name: str) -> Array:
        """See :class:`Host`."""
        if name.startswith("opt."):
            value = getattr(self.model.opt, name[4:])
            if not isinstance(value, np.ndarray):
                raise KeyError(f"{name} is no array: a scalar host changes it through model.opt")
            return value[None]
        return getattr(self.model, name)[None]

    def state(self, name: str) -> Array:
        """See :class:`Host`."""
        if name not in self._states:
            self._states[name] = getattr(self._data, name)[None]
        return self._states[name]

    def output(self, name: str) -> Array:
        """See :class:`Host`."""
        return getattr(self._data, name)[None]

    def set_timestep(self, seconds: Array) -> None:
        """See :class:`Host`."""
        self.model.opt.timestep = float(seconds[0])

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """See :class:`Watched`."""
        return np.array([has_diverged(self._data)])

    def step(self, count: int) -> None:
        """See :class:`Host`."""
        mujoco.mj_step(self.model, self._data, nstep=count)

    def forward(self) -> None:
        """See :class:`Host`."""
        mujoco.mj_forward(self.model, self._data)

    def set_const(self) -> None:
        """See :class:`Host`."""
        mujoco.mj_setConst(self.model, mujoco.MjData(self.model))

    def models(self) -> Iterator[mujoco.MjModel]:
        """See :class:`Host`."""
        yield self.model


#: Warnings after which MuJoCo gives up a state and starts anew: what follows is no prediction.
DIVERGING: Final = [
    int(warning)
    for warning in (
        mujoco.mjtWarning.mjWARN_BADQPOS,
        mujoco.mjtWarning.mjWARN_BADQVEL,
        mujoco.mjtWarning.mjWARN_BADQACC,
        mujoco.mjtWarning.mjWARN_BADCTRL,
    )
]


def has_diverged(data: mujoco.MjData) -> bool:
    """Whether MuJoCo has given up a state since the last reset; what was simulated since then is no motion."""
    return any(data.warning[kind].number for kind in DIVERGING)


class BatchHost:
    """Many simulations of one model, each with its own values of the fields that are asked for.

    A simulation that diverges, or whose model MuJoCo refuses (nothing is left of an inertia), stops where it is:
    :attr:`diverged` says which have.
    """

    simulates = True

    def __init__(self, batch: mujoco.batch.Batch) -> None:
        self.batch = batch
        self.model = batch.model
        self.nsim = batch.nsim
        self._refused = np.zeros(batch.nsim, dtype=bool)
        self._alive: NDArray[np.intp] | None = None
        self._fields: dict[str, Any] = {}
        self._states: dict[str, Any] = {}

    def field(self, name: str) -> Array:
        """See :class:`Host`."""
        if name not in self._fields:
            self._fields[name] = self.batch.expand(name)
        return self._fields[name]

    def state(self, name: str) -> Array:
        """See :class:`Host`."""
        if name not in self._states:
            self._states[name] = self.batch.bind(name)
        return self._states[name]

    def output(self, name: str) -> Array:
        """See :class:`Host`."""
        return self.batch.bind(name)

    def set_timestep(self, seconds: Array) -> None:
        """See :class:`Host`."""
        self.field("opt.timestep")[:] = seconds

    def step(self, count: int) -> None:
        """See :class:`Host`."""
        if self._alive is None or len(self._alive):
            with self._refusing():
                self.batch.step(self._alive, nstep=count)

    def rollout(self, control: Array, record: Sequence[str]) -> dict[str, Array]:
        """Steps with their controls, (nsim, nsteps, nu), and what was recorded after each, (nsim, nsteps, ...)."""
        alive = np.arange(self.nsim) if self._alive is None else self._alive
        shapes = {name: (control.shape[1], *self.output(name).shape[1:]) for name in record}
        seen = {name: np.zeros((len(alive), *shape)) for name, shape in shapes.items()}
        if len(alive):
            with self._refusing():
                self.batch.rollout(control.shape[1], control[alive], record=record, ids=alive, out=seen)
        if len(alive) == self.nsim:
            return seen
        whole = {name: np.zeros((self.nsim, *shape)) for name, shape in shapes.items()}
        for name, values in seen.items():
            whole[name][alive] = values
        return whole

    def forward(self) -> None:
        """See :class:`Host`."""
        if self._alive is None or len(self._alive):
            with self._refusing():
                self.batch.forward(self._alive)

    def set_const(self) -> None:
        """See :class:`Host`."""
        with self._refusing():
            self.batch.set_const()

    def models(self) -> Iterator[mujoco.MjModel]:
        """See :class:`Host`; the nominal model of a simulation whose own was refused."""
        one = copy.copy(self.model)
        for sim in range(self.nsim):
            yield self.model if self._refused[sim] else self.batch.get_model(sim, one)

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Simulations whose state became infinite or no number, or whose model was refused, (nsim,)."""
        counts = self.batch.warning.reshape(self.nsim, -1, 2)[:, DIVERGING, 1]
        return np.asarray(counts.any(axis=1) | self._refused)

    @contextmanager
    def _refusing(self) -> Iterator[None]:
        """What MuJoCo raises in some simulations ends those; a diverged one is not stepped on."""
        try:
            yield
        except mujoco.batch.SimulationError as fault:
            self._refused[np.asarray(fault.ids)] = True
        if self._refused.any() or self.batch.warning.any():
            self._alive = np.flatnonzero(~self.diverged)
