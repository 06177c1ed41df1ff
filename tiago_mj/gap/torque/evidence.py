"""What explanations are compared on: columns of terms, of the model's uncertainty and of unnamed structure."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.torque import blocks as blocking
from tiago_mj.gap.torque.normal import Normal, Rows
from tiago_mj.gap.torque.strips import Course
from tiago_mj.gap.torque.structure import Shape, shapes
from tiago_mj.gap.torque.terms import ON_THE_EFFORT, Term, all_terms, per_unit, reading_gain
from tiago_mj.gap.torque.torques import Torques
from tiago_mj.recordings.nominal_priors import deviation
from tiago_mj.recordings.recording import RecordingError

Array = NDArray[np.float64]

#: One standard deviation of the nominal model's numbers (masses, friction, damping, armature) as a share: real robots
#: are built within 3-5 % of their data sheets.
TOLERANCE: Final = 0.05
#: Nominal numbers are off by no more than this many standard deviations; beyond that it is a gap.
FARTHEST: Final = 2.0
#: Floor of the residual as a share of a channel's effort: what filtering, differentiating and the instant of a reversal
#: cost, measured on simulated arms that the model describes exactly.
METHOD: Final = 5e-3
#: Prior of unnamed structure: each function at most about the gap's own size.
STRUCTURE_SIZE: Final = 1.0


@dataclass(frozen=True)
class Floor:
    """What a channel's residual cannot go below.

    Attributes:
        noise: (c,) one standard deviation [N, N·m].
        spread: (c,) of the residual of a model that is as flexible as the data allow, at least the noise [N, N·m].
        correlation: (c,) its integrated autocorrelation time [s].
    """

    noise: Array
    spread: Array
    correlation: Array


class Evidence:
    """The gap, and columns that may explain it.

    Attributes:
        course, torques, terms, blocks, floor: as named.
        measured, nominal: (T, c) [N, N·m].
        moving: (T, c).
        given: terms whose size the recordings themselves leave open, with its deviation: they are in every fit.
        normal: equations over [terms, tolerance, structure].
    """

    def __init__(
        self,
        course: Course,
        torques: Torques,
        seed: int,
        known: Mapping[tuple[str, str | None], float] | None = None,
        names: Collection[str] | None = None,
    ) -> None:
        self.course, self.torques = course, torques
        cols = course.columns
        self.measured = course.stack("effort")
        self.nominal = torques.nominal[:, cols]
        self.moving = course.moving()[:, cols]
        everything = all_terms(torques, torques.nominal)
        stated = {effect for effect, _ in known or {}}
        self.terms: tuple[Term, ...] = tuple(
            t for t in everything if names is None or t.effect in names or t.effect in stated
        )
        self.units = [per_unit(term, torques, torques.nominal) for term in self.terms]
        said = {k: deviation(known or {}, t.effect, t.target) for k, t in enumerate(self.terms) if not t.shape}
        self.given: dict[int, float] = {k: size for k, size in said.items() if size is not None}
        tolerance = torques.tolerance(TOLERANCE)
        self.tolerance_columns = [change[:, cols] for change in tolerance.values()]
        self.tolerance_columns.append(self._mistimed(torques.nominal))
        self.tolerance_names = (*tolerance, "")  # the last is no number of the model
        self.shapes: tuple[Shape, ...] = shapes(course)
        gap = self.measured - self.nominal
        self._size = np.array([_rms(gap[:, c], self.moving[:, c]) for c in range(len(cols))])
        effort = np.array([_rms(self.measured[:, c], self.moving[:, c]) for c in range(len(cols))])
        noise = np.max([strip.noise for strip in course.strips], axis=0)
        noise = np.maximum(np.maximum(noise, METHOD * effort), 1e-9)
        first = np.maximum(self._size, noise)
        whole = blocking.cut(course, self.moving, 2 / course.cutoff, seed)
        self.blocks = whole
        self._build(Floor(noise, first, np.full(len(cols), 1 / course.cutoff)))
        _, residual = self.reference()
        correlation = blocking.correlation_time(residual, self.moving, course)
        self.blocks = blocking.cut(course, self.moving, float(np.median(correlation)), seed)
        if not self.blocks.names:
            files = ", ".join(dict.fromkeys(strip.trial for strip in course.strips))
            raise RecordingError(f"{files}: the motion is too short to choose between explanations: record longer")
        self._build(Floor(noise, first, correlation))
        spread, residual = self.reference()
        correlation = blocking.correlation_time(residual, self.moving & self.fitted_rows[:, None], course)
        self._build(Floor(noise, spread, correlation))

    # Columns --------------------------------------------------------------------------------------------------------

    @property
    def n_terms(self) -> int:
        """Columns of terms."""
        return len(self.terms)

    @property
    def tolerance(self) -> list[int]:
        """Columns of the nominal model's uncertainty, the given terms first; they are in every fit."""
        return [*self.given, *range(self.n_terms, self.n_terms + len(self.tolerance_columns))]

    def structure(self, families: Sequence[str] | None = None) -> list[int]:
        """Columns of unnamed structure."""
        start = self.n_terms + len(self.tolerance_columns)
        return [start + k for k, shape in enumerate(self.shapes) if families is None or shape.family in families]

    @property
    def fitted_rows(self) -> NDArray[np.bool_]:
        """(T,) rows of train and validation blocks."""
        return np.isin(self.blocks.of, self.blocks.fitted)

    @property
    def effective(self) -> Array:
        """Effective samples of each channel in train and validation blocks, (c,)."""
        n = (self.moving & self.fitted_rows[:, None]).sum(axis=0)
        return np.maximum(n / self.course.rate / self.floor.correlation, 1.0)

    def check(self) -> None:
        """Go on, if there is time.

        Raises:
            OutOfTimeError: the deadline of the torques is over.
        """
        self.torques.deadline.check()

    def _build(self, floor: Floor) -> None:
        self.check()
        self.floor = floor
        weight = 1 / (self.course.rate * floor.correlation) / floor.spread**2
        weight = np.minimum(weight, 1 / floor.spread**2)
        self.rows = Rows(self.moving, self.blocks.of, weight)
        cols = self.course.columns
        columns = [u[:, cols] for u in self.units] + self.tolerance_columns + [s.values for s in self.shapes]
        free = [FARTHEST] * len(self.tolerance_columns) + [np.inf] * len(self.shapes)
        low = np.array([*(t.low for t in self.terms), *(-bound for bound in free)])
        high = np.array([*(t.high for t in self.terms), *free])
        sizes = np.maximum(self._size, floor.noise)
        for k, size in self.given.items():
            low[k], high[k] = max(low[k], -FARTHEST * size), min(high[k], FARTHEST * size)
        precision = np.concatenate(
            [
                # Factors are expected near 1, shares near 0: a declaration's default is a clearly visible magnitude.
                [1 / t.magnitude**2 if t.unit == "-" else 0.0 for t in self.terms],
                np.ones(len(self.tolerance_columns)),
                [1 / (STRUCTURE_SIZE * sizes[s.channel]) ** 2 for s in self.shapes],
            ]
        )
        for k, size in self.given.items():
            precision[k] = 1 / size**2
        self._scales: list[float | Array] = [1.0] * self.n_terms
        self.normal = Normal(self.rows, self.measured - self.nominal, columns, precision, low, high, self.check)
        self.fitted = [int(np.searchsorted(self.rows.blocks, b)) for b in self.blocks.fitted if b in self.rows.blocks]

    # Reference ------------------------------------------------------------------------------------------------------

    def reference(self) -> tuple[Array, Array]:
        """How small the residual gets with everything in the model, blocks left out in turn.

        Of the nominal model, its tolerance, one shape of every term, and that with structure, the best on each channel.

        Returns:
            Spread (c,) [N, N·m], at least the noise; residual (T, c) [N, N·m] of the best, zero outside the blocks.
        """
        one_each = [min(k for k, t in enumerate(self.terms) if t.key == key) for key in {t.key for t in self.terms}]
        linear = sorted(k for k in one_each if self.terms[k].effect not in ON_THE_EFFORT and k not in self.given)
        sets = [self.tolerance, self.tolerance + self.structure(), linear + self.tolerance]
        sets.append(linear + self.tolerance + self.structure())
        saved = self.normal.precision.copy()
        for k in linear:
            # Without a prior the many similar terms would swing against each other outside the fitted blocks.
            self.normal.precision[k] = 1 / (max(self.terms[k].high, -self.terms[k].low)) ** 2
        outcomes = []
        for active in sets:
            residual = self._left_out_residual(active)
            used = self.moving & self.fitted_rows[:, None]
            outcomes.append(([_rms(residual[:, c], used[:, c]) for c in range(residual.shape[1])], residual))
        self.normal.precision[:] = saved
        spreads = np.array([o[0] for o in outcomes])
        best = spreads.argmin(axis=0)
        residual = np.stack([outcomes[k][1][:, c] for c, k in enumerate(best)], axis=1)
        return np.maximum(spreads.min(axis=0), self.floor.noise), residual

    def _left_out_residual(self, active: list[int]) -> Array:
        values = np.zeros_like(self.measured)
        there = self.moving & (self.blocks.of >= 0)[:, None]
        flat = np.zeros(int(there.sum()))
        for b in self.fitted:
            self.check()
            others = [k for k in self.fitted if k != b] or [b]
            inside = self.rows.of == self.rows.blocks[b]
            flat[inside] = self.normal.residual(active, self.normal.fit(active, others, bounded=False))[inside]
        values[there] = flat
        return values / np.sqrt(self.rows.weight)

    # Prediction -----------------------------------------------------------------------------------------------------

    def refresh(self, strengths: Mapping[int, float], which: Iterable[int] | None = None) -> None:
        """Renew the columns that depend on the torque that is transmitted, or on their own strength.

        Args:
            strengths: of the terms of the explanation at hand.
            which: terms to renew; all if None.
        """
        effort, gain = self.transmitted(strengths), self.gain(strengths)
        self.tolerance_columns[-1] = self._mistimed(effort * gain)
        self.normal.renew(self.tolerance[-1], self.tolerance_columns[-1])
        local = {k: v for k, v in strengths.items() if not self.terms[k].rigid}
        for k in range(self.n_terms) if which is None else {*which, *self.given}:
            self.check()
            term, strength = self.terms[k], strengths.get(k)
            scale = 1.0 if term.effect == "torque_constant" else gain[self.course.columns]
            changed = not np.array_equal(self._scales[k], scale)
            if self.stale(k) and (strength is not None or term.follows_effort or not term.rigid):
                magnitude = None if strength is None or abs(strength) < 1e-3 * abs(term.magnitude) else strength
                # Dry friction that an effect takes away must be there: other effects on the joint count.
                beside = [
                    self.terms[i].entry(v) for i, v in local.items() if i != k and self.terms[i].joint == term.joint
                ]
                self.units[k] = per_unit(term, self.torques, effort, magnitude, [] if term.rigid else beside)
                changed = True
            if changed:
                self._scales[k] = scale
                self.normal.renew(k, self.units[k][:, self.course.columns] * scale)

    def gain(self, strengths: Mapping[int, float]) -> Array:
        """What each joint's effort channel reads per true torque, (m,)."""
        gain = np.ones(len(self.course.joints))
        for k, strength in strengths.items():
            if self.terms[k].effect == "torque_constant":
                gain[self.terms[k].joint] = reading_gain(strength)
        return gain

    def _mistimed(self, effort: Array) -> Array:
        """Change of effort, (T, c), if motion and effort of one row are half a row apart in time."""
        late = 0.5 * self.course.period
        return (self.course.shifted(effort, late) - effort)[:, self.course.columns]

    def stale(self, index: int) -> bool:
        """Whether a term's column depends on the fit."""
        return self.terms[index].follows_effort or not self.terms[index].linear

    def transmitted(self, strengths: Mapping[int, float]) -> Array:
        """Torque of the drives under an explanation, (T, m) [N, N·m]; without what is wrong with the effort channel."""
        effort = self.torques.nominal.copy()
        for k, strength in strengths.items():
            if self.terms[k].effect not in ON_THE_EFFORT:
                effort += strength * self.units[k]
        return effort

    def column(self, index: int) -> Array:
        """Effort that a term adds per unit of strength, (T, c), as of the last renewal."""
        return self.units[index][:, self.course.columns] * self._scales[index]

    def predicted(self, strengths: Mapping[int, float]) -> Array:
        """Effort that an explanation predicts, (T, c) [N, N·m]."""
        effort, gain = self.nominal.copy(), self.gain(strengths)[self.course.columns]
        for k, strength in strengths.items():
            scale = 1.0 if self.terms[k].effect == "torque_constant" else gain
            effort += strength * self.units[k][:, self.course.columns] * scale
        return effort


def _rms(values: Array, used: NDArray[np.bool_]) -> float:
    return float(np.sqrt(np.mean(values[used] ** 2))) if used.any() else 0.0
