"""Grids and dead bands of the set point, looked for in what an explanation leaves.

The likelihood has no gradient for them. Before anything is fitted they are looked for in what the nominal model leaves
(:mod:`tiago_mj.gap.detectors.set_points`), which another effect may hide. Beside an explanation, how joints answer to a
set point that is off is learned from a simulation (:mod:`tiago_mj.gap.search.impulse_responses`), so that what each
magnitude would change is known without simulating it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.declare import overrides
from tiago_mj.gap.detectors import set_points
from tiago_mj.gap.detectors.set_points import MAGNITUDES_AROUND_BEST, PERIOD, ServoMotion
from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.search import impulse_responses, starts
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
#: Where a driver looks now and then: magnitudes beside each period (1.5 % apart: on a hinge a peak was 2 % wide), those
#: around each of the best, and the longest step at which a driver is followed [s].
DRIVER_WIDTHS: Final = 300
DRIVER_WIDTHS_AROUND_BEST: Final = 7
DRIVER_STEP: Final = 2e-3
#: Starts that are fitted, by what they are expected to gain, and least share of the most. Where nothing explained the
#: recordings 30 of them took 6 of a search's 8 million steps (seed 941, case 9); expected gains are within 3 % of the
#: simulated ones on a hinge. The numbers were chosen by hand; no ablation.
MAX_STARTS: Final = 6
MIN_SHARE_OF_BEST_GAIN: Final = 0.7
#: Rounds in which the magnitude of what is explained is looked for again, at most, and what one has to gain for another
#: [nats]. Chosen by hand; no ablation.
MAX_ROUNDS: Final = 3
MIN_ROUND_GAIN_NATS: Final = 3.0


def beside(state: State, fit: Fitted, least: float, *, drivers: bool = True) -> list[Start]:
    """Starts on all trials of an explanation with a grid or dead band beside it, each at the magnitudes that explain
    most of what it leaves; none where they are expected to gain less than ``least`` [nats].

    Beside the nominal model they are looked for with its numbers as they are given: as fitted they have absorbed part
    of what is looked for. Without ``drivers`` none that look now and then.
    """
    there, at = {part.label for part in fit.parts}, starts.point_of(fit)
    mine = [c for c in state.pool if _acts_on_set_points(c) and c.label not in there and (drivers or not _kind(c)[1])]
    if not fit.parts:
        at = replace(at, nuisance=np.zeros_like(at.nuisance))
    return _starts(state, at, mine, least)


def worth(seeds: Sequence[Fitted]) -> list[Fitted]:
    """Explanations beside which they are looked for: the best, and the best that is no grid or dead band itself. With a
    driver's period such a one does not miss a delay, which resembles it."""
    free = [fit for fit in seeds if not any(_acts_on_set_points(part) for part in fit.parts)]
    return [*seeds[:1], *(fit for fit in free[:1] if fit is not seeds[0])]


def looked_for_again(state: State) -> State:
    """The search with the grid or dead band of its best explanation looked for again beside the rest of it, as long as
    that brings something."""
    for _ in range(MAX_ROUNDS):
        best = state.best
        mine = [k for k, part in enumerate(best.parts) if _acts_on_set_points(part)]
        if not mine or state.everywhere.out_of_time():
            break
        rest = starts.point_of(best).without_effect(mine[0])
        again = _starts(state, rest, [best.parts[mine[0]]], 0.0)
        state = state.with_fits(state.everywhere.fit_all(again))
        if state.best.evidence < best.evidence + MIN_ROUND_GAIN_NATS:
            break
    return state


def _starts(state: State, at: Point, candidates: Sequence[Candidate], least: float) -> list[Start]:
    everywhere, motion = state.everywhere, state.motion
    if motion is None or not candidates or any(part.effect == impulse_responses.LOSES for part in at.parts):
        return []
    beside = Beside.of(everywhere, motion, at)
    found: list[tuple[float, Start]] = []
    for (_, by_driver), group in groupby(sorted(candidates, key=_kind), key=_kind):
        found += (_with_driver if by_driver else _at_commands)(beside, list(group), least)
    found.sort(key=lambda item: -item[0])
    return [start for gain, start in found[:MAX_STARTS] if gain > MIN_SHARE_OF_BEST_GAIN * found[0][0]]


def _at_commands(beside: Beside, candidates: Sequence[Candidate], least: float) -> list[tuple[float, Start]]:
    """What the best magnitudes gain where each command is rounded or ignored as it comes [nats], and starts there."""
    out: list[tuple[float, Start]] = []
    at = beside.at
    values = set_points.dense(candidates[0], beside.farthest, FINE_GRID_SHIFT)
    few = beside.in_liveliest(SCANNED_TRIALS).gains(candidates, _pairs(values, 0.0))
    for candidate, gains in zip(candidates, few, strict=True):
        found, most = [], 0.0
        for k in set_points.minima(-gains):
            fine = _around(values, k, MAGNITUDES_AROUND_BEST)
            near = beside.gains([candidate], _pairs(fine, 0.0))[0]
            if near.max() > least:
                found.append((np.array([*at.values, fine[int(np.argmax(near))]]), at.nuisance))
                most = max(most, float(near.max()))
        if found:
            out.append((most, Start((*at.parts, candidate), found[0][0], at.nuisance, tuple(found[1:]))))
    return out


def _with_driver(beside: Beside, candidates: Sequence[Candidate], least: float) -> list[tuple[float, Start]]:
    """What the best magnitudes and periods gain where a driver rounds or ignores what it looks at [nats], and starts
    there.

    The likelihood's peaks are narrow: all pairs are looked at in few trials, the best of each period in all of them.
    """
    out: list[tuple[float, Start]] = []
    at, wide = beside.at, candidates[0]
    values = wide.identity + np.geomspace(0.01, 1.0, DRIVER_WIDTHS) * (wide.high - wide.identity)
    every = np.concatenate([_pairs(values, period) for period in PERIODS])
    few = beside.in_liveliest(SCANNED_TRIALS).gains(candidates, every).reshape(len(candidates), len(PERIODS), -1)
    for candidate, gains in zip(candidates, few, strict=True):
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
            (gain, Start((*at.parts, with_period(candidate, period)), np.array([*at.values, value]), at.nuisance))
            for period, (gain, value) in ahead
            if gain > least
        ]
    return out


def _pairs(values: Array, period: float) -> Array:
    """Magnitudes, each beside a period, (nvalues, 2)."""
    return np.column_stack([values, np.full(len(values), period)])


def _around(values: Array, k: int, count: int) -> Array:
    """So many magnitudes between the neighbours of one."""
    return np.linspace(values[max(k - 1, 0)], values[min(k + 1, len(values) - 1)], count)


def _kind(candidate: Candidate) -> tuple[str, bool]:
    """What candidates are looked at together by: effect, and whether it acts when a driver looks."""
    return candidate.effect, bool(dict(candidate.fixed).get(PERIOD))


def _acts_on_set_points(candidate: Candidate) -> bool:
    """Whether it does so at every command, or whenever a driver looks, and not smoothly, as a limit."""
    declared = EFFECTS[candidate.effect]
    return declared.stage == "command" and overrides(declared, "set_point") and bool(np.isfinite(candidate.identity))


@dataclass(frozen=True)
class Beside:
    """An explanation beside which grids and dead bands are looked for.

    Attributes:
        fitter, motion, at: of the recordings, and the explanation.
        frame: what explanations are scored with there.
        base: its predictions, (ntrials, T, C).
        learned: from what joints' answers are known.
    """

    fitter: Fitter
    motion: ServoMotion
    at: Point
    frame: likelihood.Frame
    base: Array
    learned: Learned

    @classmethod
    def of(cls, fitter: Fitter, motion: ServoMotion, at: Point) -> Beside:
        """Simulate it, without and with commands lost at random."""
        base, learned = impulse_responses.learned(fitter.predict, effects_in_every_trial(fitter, at))
        fitter = replace(fitter, data=_free(fitter, motion))
        return cls(fitter, motion, at, _frame(fitter, at), base[list(fitter.trials)], learned)

    def in_liveliest(self, count: int) -> Beside:
        """The same in so many of the trials: those that are asked to move most."""
        moved = [float(np.nansum(np.abs(np.diff(self.motion.requested[t], axis=0)))) for t in self.fitter.trials]
        rows = sorted(np.argsort(moved)[-count:].tolist())
        fitter, at = self.fitter.part(rows), replace(self.at, nuisance=self.fitter.of(rows, self.at.nuisance))
        return replace(self, fitter=fitter, at=at, frame=_frame(fitter, at), base=self.base[rows])

    @property
    def farthest(self) -> float:
        """How far set points are from the joints' zeros [m, rad]."""
        return float(np.nanmax(np.abs(self.motion.requested[list(self.fitter.trials)])))

    def gains(self, candidates: Sequence[Candidate], pairs: Array) -> Array:
        """What pairs of a magnitude and a driver's period [s] explain, (npairs, 2) to (ncandidates, npairs) [nats], for
        each of the candidates, which are one effect; the nominal numbers are integrated out."""
        wide = replace(candidates[0], target=None)
        answers = [self._answers(candidate) for candidate in candidates]
        nothing = likelihood.log_likelihood(self.frame, self.base[None])[0]
        out = np.empty((len(candidates), len(pairs)))
        for first in range(0, len(pairs), AT_ONCE):
            some = slice(first, first + AT_ONCE)
            off = self._offsets(wide, pairs[some])
            for each, mine in zip(out, answers, strict=True):
                predicted = np.repeat(self.base[None], len(off), axis=0)
                for a, c, response in mine:
                    predicted[:, :, 1:, c] += _convolved(off[..., a], response)
                each[some] = likelihood.log_likelihood(self.frame, predicted) - nothing
        return out

    def _answers(self, candidate: Candidate) -> list[tuple[int, int, Array]]:
        """Actuators that the candidate acts on, channels of their joints, and how these answer, (rows,)."""
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
        """How far off pairs put the set points, on average over a row, (npairs, ntrials, T - 1, nactuators)."""
        plant, on, motion = self.fitter.predict.plant, self.fitter.predict.on, self.motion
        if pairs[0, 1]:
            steps = set_points.driven(plant, on, motion, wide, pairs, self.fitter.trials, DRIVER_STEP)
            return np.stack([off.mean(axis=2) for off in steps], axis=2)
        passed = [set_points.passed(plant, on, motion, wide, pairs[:, 0], t) for t in self.fitter.trials]
        return np.stack(passed, axis=1) - motion.requested[list(self.fitter.trials)]


def _frame(fitter: Fitter, at: Point) -> likelihood.Frame:
    return likelihood.frame(fitter.data, fitter.weight, fitter.responses, fitter.per_trial, at.nuisance)


def _free(fitter: Fitter, motion: ServoMotion) -> Data:
    """What was measured of the actuated joints while nothing was touched: how a joint answers there is learned."""
    plant, trials = fitter.predict.plant, list(fitter.trials)
    value = np.full_like(fitter.data.value, np.nan)
    for a, joint in enumerate(plant.wiring.targets.actuated):
        for c, name in enumerate(fitter.data.channels):
            if name in (f"position.{plant.joints[joint]}", f"velocity.{plant.joints[joint]}"):
                free = np.isfinite(motion.deviation[trials, :, a])
                value[:, : free.shape[1], c] = np.where(free, fitter.data.value[:, : free.shape[1], c], np.nan)
    return replace(fitter.data, value=value)


def _convolved(offsets: Array, response: Array) -> Array:
    """What offsets (..., T) change by an answer (rows,) to one, (..., T)."""
    rows = offsets.shape[-1]
    size = 1 << (rows + len(response)).bit_length()
    both = np.fft.rfft(offsets, size) * np.fft.rfft(response, size)
    return np.asarray(np.fft.irfft(both, size)[..., :rows])
