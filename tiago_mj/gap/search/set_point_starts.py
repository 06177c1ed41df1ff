"""Grids and dead bands of the set point, looked for in what an explanation leaves.

The likelihood has no gradient for them. Before anything is fitted they are looked for in what the nominal model leaves
(:mod:`tiago_mj.gap.detectors.set_points`), which another effect may hide. Beside an explanation, how joints answer to a
set point that is off is learned from a simulation (:mod:`tiago_mj.gap.search.impulse_responses`), so that what each
magnitude would change is known without simulating it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.declare import overrides
from tiago_mj.gap.detectors import set_points
from tiago_mj.gap.detectors.set_points import MAX_SQUARED_RESIDUAL, PERIOD, ServoMotion
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.search import impulse_responses, starts
from tiago_mj.gap.search.impulse_responses import Learned
from tiago_mj.gap.search.lost_commands import effects_in_every_trial
from tiago_mj.gap.search.state import State

Array = NDArray[np.float64]

#: Magnitudes that are looked at together, for the memory that their changes take.
AT_ONCE: Final = 256
#: Rounds in which the magnitude of what is explained is looked for again, at most, and what one has to gain for another
#: [nats]. Chosen by hand; no ablation.
MAX_ROUNDS: Final = 3
MIN_ROUND_GAIN_NATS: Final = 3.0


def beside(state: State, fit: Fitted, least: float) -> list[Start]:
    """Starts on all trials of an explanation with a grid or dead band beside it, each at the magnitudes that explain
    most of what it leaves; none where they are expected to gain less than ``least`` [nats]."""
    there = {part.label for part in fit.parts}
    mine = [c for c in state.pool if _acts_on_set_points(c) and c.label not in there]
    return _starts(state, starts.point_of(fit), mine, least)


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
    base, learned = impulse_responses.learned(everywhere.predict, effects_in_every_trial(everywhere, at))
    out = []
    for candidate in candidates:
        cost = partial(_costs, everywhere, motion, candidate, base=base, learned=learned)
        values = _magnitudes(everywhere, motion, candidate)
        coarse = cost(values=np.append(values, candidate.identity))
        near = [k for k in set_points.minima(coarse[:-1]) if coarse[-1] - coarse[k] > least]
        fine = [
            np.linspace(values[max(k - 1, 0)], values[min(k + 1, len(values) - 1)], set_points.MAGNITUDES_AROUND_BEST)
            for k in near
        ]
        found = [float(some[int(np.argmin(cost(values=some)))]) for some in fine]
        if found:
            several = [np.array([*at.values, value]) for value in found]
            also = tuple((value, at.nuisance) for value in several[1:])
            out.append(Start((*at.parts, candidate), several[0], at.nuisance, also))
    return out


def _acts_on_set_points(candidate: Candidate) -> bool:
    """Whether it does so at every command, and not smoothly, as a limit."""
    declared = EFFECTS[candidate.effect]
    smooth = not np.isfinite(candidate.identity)
    return (
        declared.stage == "command"
        and overrides(declared, "set_point")
        and not smooth
        and not dict(candidate.fixed).get(PERIOD)
    )


def _magnitudes(fitter: Fitter, motion: ServoMotion, candidate: Candidate) -> Array:
    """Magnitudes to look at, rising."""
    return set_points.dense(candidate, float(np.nanmax(np.abs(motion.requested[list(fitter.trials)]))))


def _costs(
    fitter: Fitter, motion: ServoMotion, candidate: Candidate, *, values: Array, base: Array, learned: Learned
) -> Array:
    """Cost of each magnitude in the fitted trials, (nvalues,) [nats]."""
    plant, data, trials = fitter.predict.plant, fitter.data, list(fitter.trials)
    commands = plant.wiring.targets.command
    index = [commands.index(name) for name in candidate.target or commands]
    total = np.zeros(len(values))
    own = np.sqrt(data.sigma**2 - data.common**2)
    for a, joint in enumerate(plant.wiring.targets.actuated):
        names = (f"position.{plant.joints[joint]}", f"velocity.{plant.joints[joint]}")
        mine = [c for c, name in enumerate(data.channels) if name in names]
        if a not in index or not mine:
            continue
        whole = fitter.predict.data.value[:, 1:, mine]
        known = np.isfinite(whole) & np.isfinite(motion.deviation[:, 1:, a, None])
        _, response = learned.of(motion, a, mine, known, late=True)
        left = np.where(known[trials], (data.value - base[trials])[:, 1:, mine], 0.0)
        for some, offsets in _offsets(fitter, motion, candidate, values, a):
            for c in range(len(mine)):
                change = _convolved(offsets, response[c])
                ratio = (left[None, :, :, c] - change) / own[None, :, 1:, mine[c]]
                square = np.where(known[trials][None, :, :, c], ratio**2, 0.0)
                cost = np.minimum(square, MAX_SQUARED_RESIDUAL).sum(axis=(1, 2))
                total[some] += 0.5 * fitter.weight[mine[c]] ** 2 * cost
    return total


def _offsets(
    fitter: Fitter, motion: ServoMotion, candidate: Candidate, values: Array, actuator: int
) -> Iterator[tuple[slice, Array]]:
    """How far off magnitudes put the set points of an actuator, some at a time, (n, ntrials, T - 1)."""
    predict = fitter.predict
    for first in range(0, len(values), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        yield (
            some,
            np.stack(
                [
                    set_points.passed(predict.plant, predict.on, motion, candidate, values[some], t)[:, :, actuator]
                    - motion.requested[t, :, actuator]
                    for t in fitter.trials
                ],
                axis=1,
            ),
        )


def _convolved(offsets: Array, response: Array) -> Array:
    """What offsets (..., T) change by an answer (rows,) to one, (..., T)."""
    rows = offsets.shape[-1]
    size = 1 << (rows + len(response)).bit_length()
    both = np.fft.rfft(offsets, size) * np.fft.rfft(response, size)
    return np.asarray(np.fft.irfft(both, size)[..., :rows])
