"""Effects on many simulations whose episodes begin at different times.

What effects remember is an array over the simulations of a chain, made anew at the start of an episode. Simulations
that start together are a cohort: they share one runner, which serves them until the last of them starts again. Where
every simulation is of one cohort, as it is while episodes have one length, a runner works on the batch itself; else on
copies of its members' rows, which are written back. Without effects there is nothing to remember, and one cohort lasts.

Effects may be drawn anew for every episode. Simulations in which others act are then of other cohorts, so that what one
draws at random does not depend on what acts in another.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import mujoco.batch
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.host import DIVERGING
from tiago_mj.effects.now import Wiring
from tiago_mj.effects.runner import Runner
from tiago_mj.effects.spec import Entry

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
#: Of a simulation's generator the effects of its next episode.
DrawEffects = Callable[[np.random.Generator], Sequence[Entry]]


class Members:
    """The simulations of one cohort, as a :class:`tiago_mj.effects.host.Host`.

    Attributes:
        rows: the members, of the batch.
        present: which of them have not started another episode since.
        everyone: whether the cohort is the whole batch, so that nothing needs to be copied.
        stepped: of a cohort that is the whole batch, those that the next step is of; None: all.
        failed: those in which MuJoCo raised an error.
    """

    simulates = True

    def __init__(self, batch: mujoco.batch.Batch, rows: Rows) -> None:
        self.model = batch.model
        self.nsim = len(rows)
        self.rows = rows
        self.present = np.ones(len(rows), dtype=bool)
        self.stepped: Rows | None = None
        self.failed: list[int] = []
        self._batch = batch
        self.everyone = self.nsim == batch.nsim
        self._fields: dict[str, Array] = {}
        self._states: dict[str, Array] = {}
        self._views: dict[str, Array] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Without the views of the batch's memory, which a copy makes of its own batch."""
        return {**vars(self), "_views": {}}

    @property
    def left(self) -> Rows:
        """Members whose episode goes on."""
        return self.rows[self.present]

    def leave(self, rows: Rows) -> None:
        """These start another episode: nothing is written to them any more."""
        self.present &= ~np.isin(self.rows, rows)
        self.everyone = self.everyone and bool(self.present.all())

    def field(self, name: str) -> Array:
        """See :class:`Host`."""
        return self._of(self._fields, name, self._batch.expand)

    def state(self, name: str) -> Array:
        """See :class:`Host`."""
        return self._of(self._states, name, self._batch.bind)

    def _of(self, copies: dict[str, Array], name: str, whole: Callable[[str], Array]) -> Array:
        if self.everyone:
            if name not in self._views:
                self._views[name] = whole(name)
            return self._views[name]
        if name not in copies:
            copies[name] = whole(name)[self.rows]
        return copies[name]

    def output(self, name: str) -> Array:
        """See :class:`Host`."""
        return self._of({}, name, self._batch.bind)

    def set_timestep(self, seconds: Array) -> None:
        """See :class:`Host`."""
        self.field("opt.timestep")[:] = seconds

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """See :class:`tiago_mj.effects.host.Watched`."""
        warned: NDArray[np.bool_] = self._batch.warning[self.rows][:, DIVERGING, 1].any(axis=1)
        return warned | np.isin(self.rows, self.failed)

    def write(self) -> None:
        """Write what was changed to the batch."""
        left = self.left
        for name, copied in self._fields.items():
            self._batch.expand(name)[left] = copied[self.present]
        for name, copied in self._states.items():
            self._batch.bind(name)[left] = copied[self.present]

    def _renew(self) -> None:
        """Copies of what the batch has changed; whoever holds one has the new values."""
        for name, copied in self._states.items():
            copied[:] = self._batch.bind(name)[self.rows]

    def step(self, count: int) -> None:
        """See :class:`Host`."""
        self.write()
        try:
            self._batch.step(self.stepped if self.everyone else self.left, nstep=count)
        except mujoco.batch.SimulationError as fault:  # the others have been stepped
            self.failed += [int(k) for k in fault.ids]
        self._renew()

    def forward(self) -> None:
        """See :class:`Host`."""
        self.write()
        self._batch.forward(None if self.everyone else self.left)

    def set_const(self) -> None:
        """See :class:`Host`."""
        self.write()
        self._batch.set_const(None if self.everyone else self.left)
        for name, copied in self._fields.items():
            copied[:] = self._batch.expand(name)[self.rows]

    def models(self) -> Iterator[mujoco.MjModel]:
        """See :class:`Host`."""
        self.write()
        one = copy.copy(self.model)
        for row in self.rows:
            yield self._batch.get_model(int(row), one)


class Cohort:
    """One runner and the simulations that it serves.

    Args:
        batch: the simulations.
        wiring: their parts.
        sims: effects of each member.
        rows: the members, at the start of their episodes.
        generators: one a simulation of the batch.
    """

    def __init__(
        self,
        batch: mujoco.batch.Batch,
        wiring: Wiring,
        sims: Sequence[Sequence[Entry]],
        rows: Rows,
        generators: Sequence[np.random.Generator],
    ) -> None:
        self.members = Members(batch, rows)
        self._generators = generators
        self.runner = Runner(self.members, wiring, sims, self._uniform)
        self.passes_readings = self.runner.chain.passes_readings

    def start(self, period: float, substeps: int, contact: Any) -> None:
        """Apply the effects to the members' models and initial states; see :meth:`Runner.start`."""
        self.runner.start(period, substeps, contact)
        self.members.write()

    def advance(self, command: Array) -> None:
        """Let commands, (nsim of the batch, N), act on the members for one control period."""
        members = self.members
        self.runner.advance(command if members.everyone else command[members.rows])

    # What is measured: of the members that are left -----------------------------------------------------------------

    def reading(self, newtons: Array, units_per_newton: Callable[[Array], Array], noise: Array) -> Array:
        """See :class:`tiago_mj.envs.sensors.Measured`."""
        reading = self.runner.chain.reading(self._filled(newtons), units_per_newton, self._filled(noise))
        return reading[self.members.present]

    def position(self, position: Array) -> Array:
        """See :class:`tiago_mj.envs.sensors.Measured`."""
        return self.runner.chain.position(self._filled(position))[self.members.present]

    def velocity(self, velocity: Array) -> Array:
        """See :class:`tiago_mj.envs.sensors.Measured`."""
        return self.runner.chain.velocity(self._filled(velocity))[self.members.present]

    def _filled(self, values: Array) -> Array:
        """Zeros for members that have left."""
        full = np.zeros((self.members.nsim, *values.shape[1:]))
        full[self.members.present] = values
        return full

    def _uniform(self, shape: tuple[int, ...]) -> Array:
        """Each member's numbers come from its own generator; who has left draws none."""
        drawn = np.zeros(shape)
        for k in np.flatnonzero(self.members.present).tolist():
            drawn[k] = self._generators[int(self.members.rows[k])].random(shape[1:])
        return drawn


class Cohorts:
    """All simulations of a batch, as cohorts.

    Args:
        batch: the simulations.
        wiring: their parts.
        effects: that each of them has.
        generators: one a simulation; may be replaced in place.
        draw_effects: of a simulation's generator what it has beside these in its next episode; None: nothing.

    Attributes:
        now: the cohorts.
        lasting: whether there is one for good, of all: without effects.
    """

    def __init__(
        self,
        batch: mujoco.batch.Batch,
        wiring: Wiring,
        effects: tuple[Entry, ...],
        generators: list[np.random.Generator],
        draw_effects: DrawEffects | None = None,
    ) -> None:
        self._batch, self._wiring, self._effects, self._generators = batch, wiring, effects, generators
        self._draw_effects = draw_effects
        self.now: list[Cohort] = []
        self.lasting = not effects and draw_effects is None
        for name in ("qfrc_actuator", "qfrc_smooth", "actuator_force") if not self.lasting else ():
            batch.bind(name)  # a batch fills what is asked for at its next call: ask before the first

    def leave(self, rows: Rows) -> None:
        """These are about to start another episode."""
        if self.lasting:
            return
        for cohort in self.now:
            cohort.members.leave(rows)
        self.now = [cohort for cohort in self.now if cohort.members.present.any()]

    def start(
        self, rows: Rows, period: float, substeps: int, contacts: Sequence[tuple[float, float, int] | None]
    ) -> None:
        """Begin the episodes of simulations whose nominal models and initial states are set.

        Args:
            rows: which.
            period: nominal control period [s].
            substeps: physics steps in it.
            contacts: one each, see :func:`tiago_mj.envs.start.contact_of`.
        """
        if self.lasting:
            if not self.now:
                every = np.arange(self._batch.nsim)
                self._begin(every, [()] * len(every), period, substeps, None)
            return
        sims = [self._effects_of(row) for row in rows.tolist()]
        together: dict[tuple[Any, ...], list[int]] = {}
        for k, (entries, touched) in enumerate(zip(sims, contacts, strict=True)):
            points = None if touched is None else touched[2]
            together.setdefault((points, *((one.name, one.target) for one in entries)), []).append(k)
        for (points, *_), chosen in together.items():
            given = [c for k in chosen if (c := contacts[k]) is not None]
            # Stiffness and damping may be each simulation's own; the number of contact points is of the shape.
            stiffness, damping = (np.array([c[which] for c in given]) for which in (0, 1))
            contact = None if points is None else (stiffness, damping, points)
            self._begin(rows[chosen], [sims[k] for k in chosen], period, substeps, contact)

    def _begin(self, rows: Rows, sims: Sequence[Sequence[Entry]], period: float, substeps: int, contact: Any) -> None:
        cohort = Cohort(self._batch, self._wiring, sims, rows, self._generators)
        cohort.start(period, substeps, contact)
        self.now.append(cohort)

    def _effects_of(self, row: int) -> tuple[Entry, ...]:
        """What acts in a simulation in its next episode."""
        if self._draw_effects is None:
            return self._effects
        return (*self._effects, *self._draw_effects(self._generators[row]))

    def advance(self, command: Array, rows: Rows | None) -> list[int]:
        """Let commands act for one control period.

        Args:
            command: (nsim, N).
            rows: which are stepped, the others leave their cohorts; None: all.

        Returns:
            Those in which MuJoCo has raised an error.
        """
        if self.lasting:
            self.now[0].members.stepped = rows
        elif rows is not None:
            self.leave(np.setdiff1d(np.arange(self._batch.nsim), rows))
        failed: list[int] = []
        for cohort in self.now:
            cohort.members.failed.clear()
            cohort.advance(command)
            failed += cohort.members.failed
        return failed
