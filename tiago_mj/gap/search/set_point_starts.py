"""Starts for quantization and dead bands of the set point, found in the residual of an explanation.

The likelihood has no useful gradient in their magnitude. They are first sought in the residual of the nominal model
(:mod:`tiago_mj.gap.detectors.set_points`), where another effect may hide them. Beside an explanation, the impulse
responses of the joints to a set point that is off are estimated from a simulation
(:mod:`tiago_mj.gap.search.impulse_responses`); the change at each magnitude then follows by convolution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.declare import overrides
from tiago_mj.gap.detectors import set_points
from tiago_mj.gap.detectors.set_points import MAGNITUDES_AROUND_BEST, PERIOD, ServoMotion
from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.changed_channels import Around
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.remembered import remembered
from tiago_mj.gap.search import impulse_responses, ranking, rounds
from tiago_mj.gap.search.driver_period import PERIODS, with_period
from tiago_mj.gap.search.impulse_responses import Learned
from tiago_mj.gap.search.lost_commands import effects_in_every_trial
from tiago_mj.gap.search.state import State

Array = NDArray[np.float64]

#: Magnitudes that are looked at together, for the memory that their changes take.
AT_ONCE: Final = 512
#: Trials in which all magnitudes are looked at; the best are in all. The likelihood's peaks are narrow: a grid's lines
#: move by this share of a step from one magnitude to the next (on a hinge beside a delay its peak is 0.5 % wide).
SCANNED_TRIALS: Final = 2
FINE_GRID_SHIFT: Final = 0.1
#: Where a driver looks now and then: magnitudes beside each period (1.5 % apart: on a hinge a peak was 2 % wide), and
#: those around each of the best.
DRIVER_WIDTHS: Final = 300
DRIVER_WIDTHS_AROUND_BEST: Final = 7
#: Starts that are fitted, by what they are expected to gain, and least share of the most. Where nothing explained
#: the recordings 30 of them took 6 of a search's 8 million steps (seed 941, case 9); expected gains are within 3 %
#: of the simulated ones on a hinge. Halved and doubled, none of 32 answers about hinges changes (varied.json).
MAX_STARTS: Final = 6
MIN_SHARE_OF_BEST_GAIN: Final = 0.7
#: Rounds in which the magnitude of what is explained is looked for again, at most, and what one has to gain for
#: another [nats]. Halved and doubled, none of 31 answers about hinges changes (varied.json).
MAX_ROUNDS: Final = 3
MIN_ROUND_GAIN_NATS: Final = 3.0


def beside(state: State, fit: Fitted, least: float, *, drivers: bool = True) -> list[Start]:
    """Starts on all trials that add a quantization or dead band to an explanation, at the magnitudes with the largest
    log likelihood; none where the expected gain is below ``least`` [nats].

    Beside the nominal model its nuisances are 0: the fitted ones have absorbed part of the effect. Without ``drivers``
    only those that act at every command are sought.
    """
    there, point = {part.label for part in fit.parts}, Point.of(fit)
    mine = [c for c in state.pool if _acts_on_set_points(c) and c.label not in there and (drivers or not _kind(c)[1])]
    if not fit.parts:
        point = replace(point, nuisance=np.zeros_like(point.nuisance))
    return _starts(state, point, mine, least)


def worth(seeds: Sequence[Fitted]) -> list[Fitted]:
    """Explanations to which a quantization or dead band is added: the best, and the best without one. A driver's period
    resembles a delay, so that with it a delay does not look missing."""
    free = [fit for fit in seeds if not any(_acts_on_set_points(part) for part in fit.parts)]
    return [*seeds[:1], *(fit for fit in free[:1] if fit is not seeds[0])]


def looked_for_again(state: State) -> State:
    """The search with the quantization or dead band of its best explanation sought again beside its other effects, as
    long as the evidence grows; the next that share the effect are fitted from what was found for it, where no slope of
    theirs leads."""
    for _ in range(MAX_ROUNDS):
        best = state.best
        mine = [k for k, part in enumerate(best.parts) if _acts_on_set_points(part)]
        if not mine or state.full.out_of_time():
            break
        rest = Point.of(best).without_effect(mine[0])
        again = _starts(state, rest, [best.parts[mine[0]]], 0.0)
        state = state.with_fits(state.full.fit_all(again))
        if state.best.evidence < best.evidence + MIN_ROUND_GAIN_NATS:
            break
    return state if state.full.out_of_time() else state.with_fits(state.full.fit_all(_as_in_the_best(state)))


def _as_in_the_best(state: State) -> list[Start]:
    """Starts of the next explanations that share the best's quantization or dead band, with the best's magnitude:
    however far behind they are, that may be all that is wrong."""
    best, out = state.best, []
    found = {
        part.label: (part, value)
        for part, value in zip(best.parts, best.values.tolist(), strict=True)
        if _acts_on_set_points(part)
    }
    for fit in ranking.unique_by_labels(state.fits):
        shared = {k: found[part.label] for k, part in enumerate(fit.parts) if part.label in found}
        if any((fit.parts[k], fit.values[k]) != there for k, there in shared.items()):
            parts, values = list(fit.parts), fit.values.copy()
            for k, there in shared.items():
                parts[k], values[k] = there
            out.append(Start(tuple(parts), values, fit.nuisance))
    return out[: rounds.MAX_RIVALS]


def _starts(state: State, point: Point, candidates: Sequence[Candidate], least: float) -> list[Start]:
    full, motion = state.full, state.motion
    losing = (*(part.effect for part in point.parts), *(entry.name for entry in full.given))
    if motion is None or not candidates or impulse_responses.LOSES in losing:
        return []

    def work() -> list[Start]:
        beside = Beside.of(full, motion, point)
        found: list[tuple[float, Start]] = []
        for (_, by_driver), group in groupby(sorted(candidates, key=_kind), key=_kind):
            found += (_with_driver if by_driver else _at_commands)(beside, list(group), least)
        found.sort(key=lambda item: -item[0])
        return [start for gain, start in found[:MAX_STARTS] if gain > MIN_SHARE_OF_BEST_GAIN * found[0][0]]

    depends_on = ("set points", full.settings(), point, list(candidates), least)
    return remembered(full.predict, work, depends_on, full.out_of_time)


def _at_commands(beside: Beside, candidates: Sequence[Candidate], least: float) -> list[tuple[float, Start]]:
    """Gain [nats] and starts of the best magnitudes where each command is rounded or ignored as it arrives."""
    out: list[tuple[float, Start]] = []
    point = beside.point
    values = set_points.dense(candidates[0], beside.farthest, FINE_GRID_SHIFT)
    first_gains = beside.in_liveliest(SCANNED_TRIALS).gains(candidates, _pairs(values, 0.0))
    for candidate, gains in zip(candidates, first_gains, strict=True):
        found, most = [], 0.0
        for k in set_points.minima(-gains):
            fine = _around(values, k, MAGNITUDES_AROUND_BEST)
            near = beside.gains([candidate], _pairs(fine, 0.0))[0]
            if near.max() > least:
                found.append((np.array([*point.values, fine[int(np.argmax(near))]]), point.nuisance))
                most = max(most, float(near.max()))
        if found:
            out.append((most, Start((*point.parts, candidate), found[0][0], point.nuisance, tuple(found[1:]))))
    return out


def _with_driver(beside: Beside, candidates: Sequence[Candidate], least: float) -> list[tuple[float, Start]]:
    """Gain [nats] and starts of the best magnitudes and periods where a driver rounds or ignores the set point that it
    reads.

    The likelihood has narrow peaks: all pairs are tried in few trials, the best of each period in all of them.
    """
    out: list[tuple[float, Start]] = []
    point, wide = beside.point, candidates[0]
    values = wide.identity + np.geomspace(0.01, 1.0, DRIVER_WIDTHS) * (wide.high - wide.identity)
    every = np.concatenate([_pairs(values, period) for period in PERIODS])
    first_gains = (
        beside.in_liveliest(SCANNED_TRIALS).gains(candidates, every).reshape(len(candidates), len(PERIODS), -1)
    )
    for candidate, gains in zip(candidates, first_gains, strict=True):
        peaks = [(period, k) for period, one in zip(PERIODS, gains, strict=True) for k in set_points.minima(-one)]
        if not peaks:  # what is explained rises up to a bound, or falls from one, whatever the period
            continue
        near = np.concatenate([_pairs(_around(values, k, DRIVER_WIDTHS_AROUND_BEST), period) for period, k in peaks])
        (there,) = beside.gains([candidate], near)
        best: dict[float, tuple[float, float]] = {}
        for gain, (value, period) in zip(there.tolist(), near.tolist(), strict=True):
            best[period] = max(best.get(period, (-np.inf, value)), (gain, value))
        ahead = sorted(best.items(), key=lambda item: -item[1][0])[: set_points.MAX_SIMULATED]
        out += [
            (
                gain,
                Start((*point.parts, with_period(candidate, period)), np.array([*point.values, value]), point.nuisance),
            )
            for period, (gain, value) in ahead
            if gain > least
        ]
    return out


def _pairs(values: Array, period: float) -> Array:
    """Magnitudes, each with a period, (nvalues, 2)."""
    return np.column_stack([values, np.full(len(values), period)])


def _around(values: Array, k: int, count: int) -> Array:
    """A finer grid of magnitudes between the neighbours of one."""
    return np.linspace(values[max(k - 1, 0)], values[min(k + 1, len(values) - 1)], count)


def _kind(candidate: Candidate) -> tuple[str, bool]:
    """Effect, and whether it acts when a driver reads the set point: candidates that share both are tried together."""
    return candidate.effect, bool(dict(candidate.fixed).get(PERIOD))


def _acts_on_set_points(candidate: Candidate) -> bool:
    """Whether a candidate changes set points discontinuously, at every command or when a driver reads them; a limit
    does not."""
    declared = EFFECTS[candidate.effect]
    return declared.stage == "command" and overrides(declared, "set_point") and bool(np.isfinite(candidate.identity))


@dataclass(frozen=True)
class Beside:
    """An explanation with what predicts the change by a quantization or dead band: impulse responses and the
    likelihood.

    Attributes:
        fitter, motion, at: of the recordings, and the explanation.
        frame: what explanations are scored with there.
        base: its predictions, (ntrials, T, C).
        learned: from what joints' answers are known.
    """

    fitter: Fitter
    motion: ServoMotion
    point: Point
    frame: likelihood.Frame
    base: Array
    learned: Learned

    @classmethod
    def of(cls, fitter: Fitter, motion: ServoMotion, point: Point) -> Beside:
        """Simulate the explanation without and with randomly lost commands, and estimate the impulse responses."""
        _, learned = impulse_responses.learned(fitter.predict, effects_in_every_trial(fitter, point))
        base = fitter.predictions([point])[0]
        fitter = replace(fitter, data=_free(fitter, motion))
        return cls(fitter, motion, point, _frame(fitter, point), base, learned)

    def in_liveliest(self, count: int) -> Beside:
        """The same on the ``count`` trials with the largest commanded motion of those in which candidates act."""
        moved = [float(np.nansum(np.abs(np.diff(self.motion.requested[t], axis=0)))) for t in self.fitter.trials]
        rows = sorted(np.argsort(np.where(self.fitter.acting, moved, -np.inf))[-count:].tolist())
        fitter, point = self.fitter.part(rows), replace(self.point, nuisance=self.fitter.of(rows, self.point.nuisance))
        return replace(self, fitter=fitter, point=point, frame=_frame(fitter, point), base=self.base[rows])

    @property
    def farthest(self) -> float:
        """Largest distance of a set point from its joint's zero [m, rad]."""
        return float(np.nanmax(np.abs(self.motion.requested[list(self.fitter.trials)])))

    def gains(self, candidates: Sequence[Candidate], pairs: Array) -> Array:
        """Gain in log likelihood [nats] at each pair of magnitude and driver's period [s], (npairs, 2) to (ncandidates,
        npairs), nuisances integrated out; the candidates are one effect."""
        wide = replace(candidates[0], target=None)
        answers = [self._answers(candidate) for candidate in candidates]
        responses = {(a, c): one for mine in answers for a, c, one in mine}
        around = Around.of(self.frame, self.base)
        out = np.empty((len(candidates), len(pairs)))
        for first in range(0, len(pairs), AT_ONCE):
            some = slice(first, first + AT_ONCE)
            off = self._offsets(wide, pairs[some]) * self.fitter.acting[:, None, None]
            changed = {}
            for (a, c), response in responses.items():
                predicted = np.repeat(self.base[None, ..., c], len(off), axis=0)
                predicted[:, :, 1:] += _convolved(off[..., a], response)
                changed[c] = around.white(c, predicted)
            for each, mine in zip(out, answers, strict=True):
                each[some] = around.log_likelihoods({c: changed[c] for _, c, _ in mine}) - around.log_likelihood
        return out

    def _answers(self, candidate: Candidate) -> list[tuple[int, int, Array]]:
        """Actuators that the candidate acts on, channels of their joints, and impulse responses of these, (rows,)."""
        plant, data = self.fitter.predict.plant, self.fitter.predict.data
        commands = plant.wiring.targets.command
        index = [commands.index(name) for name in candidate.target or commands]
        out = []
        for a, joint in enumerate(plant.wiring.targets.actuated):
            names = (f"position.{plant.joints[joint]}", f"velocity.{plant.joints[joint]}")
            mine = [c for c, name in enumerate(data.channels) if name in names]
            if a in index and mine:
                known = np.isfinite(data.value[:, 1:, mine]) & np.isfinite(self.motion.deviation[:, 1:, a, None])
                _, responses = self.learned.of(self.motion, a, mine, known, late=True)
                out += [(a, c, one) for c, one in zip(mine, responses, strict=True)]
        return out

    def _offsets(self, wide: Candidate, pairs: Array) -> Array:
        """Mean offset of the set point over each row for every pair, (npairs, ntrials, T - 1, nactuators)."""
        plant, on, motion = self.fitter.predict.plant, self.fitter.predict.on, self.motion
        if pairs[0, 1]:
            steps = set_points.driven(plant, on, motion, wide, pairs, self.fitter.trials)
            return np.stack([off.mean(axis=2) for off in steps], axis=2)
        passed = [set_points.passed(plant, on, motion, wide, pairs[:, 0], t) for t in self.fitter.trials]
        return np.stack(passed, axis=1) - motion.requested[list(self.fitter.trials)]


def _frame(fitter: Fitter, point: Point) -> likelihood.Frame:
    return likelihood.frame(fitter.data, fitter.weight, fitter.responses, fitter.per_trial, point.nuisance)


def _free(fitter: Fitter, motion: ServoMotion) -> Data:
    """Measurements of the actuated joints while nothing is touched, NaN elsewhere: impulse responses hold there."""
    plant, trials = fitter.predict.plant, list(fitter.trials)
    value = np.full_like(fitter.data.value, np.nan)
    for a, joint in enumerate(plant.wiring.targets.actuated):
        for c, name in enumerate(fitter.data.channels):
            if name in (f"position.{plant.joints[joint]}", f"velocity.{plant.joints[joint]}"):
                free = np.isfinite(motion.deviation[trials, :, a])
                value[:, : free.shape[1], c] = np.where(free, fitter.data.value[:, : free.shape[1], c], np.nan)
    return replace(fitter.data, value=value)


def _convolved(offsets: Array, response: Array) -> Array:
    """Convolution of set point offsets (..., T) with an impulse response (rows,), (..., T)."""
    rows = offsets.shape[-1]
    size = fft.next_fast_len(rows + len(response) - 1, real=True)
    both = fft.rfft(offsets, size) * fft.rfft(response, size)
    return np.asarray(fft.irfft(both, size)[..., :rows])
