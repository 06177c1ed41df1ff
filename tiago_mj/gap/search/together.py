"""Sets of effects that are sought together along a motion, where the torques of most effects add up.

A search that adds one effect after another ends at a wrong one where several are large: on an arm whose every joint
rubs and which carries a load, a torque constant of a third explains more than any one of them, and beside it none of
them is missed. Torques are linear in friction, inertia, a load and its moments, so that one matrix of responses, from
one simulation for each effect and joint, holds the least-squares fit of every set of them (Atkeson, An & Hollerbach
1986, for a load; Swevers et al. 1997, for friction beside it). The best sets of each size are then fitted as every
other explanation is.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference import likelihood, placing
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.whitening import Normal, Whitening
from tiago_mj.gap.search import mounting, on_each, ranking, starts
from tiago_mj.gap.search.state import State

Array = NDArray[np.float64]

#: Effects of a set at most, each on every joint.
MOST: Final = 4
#: A set is taken where it is this far ahead [nats]. Three sets that dig into what the models of real robots lack were
#: 4, 10 and 21 ahead (a TIAGo's arm, a double pendulum, a UR10e with a load); the right ones of five simulated arms and
#: of a UR10e with a load and friction, which adding one effect after another misses, 34 to 1000.
AHEAD_NATS: Final = 30.0
#: And leaves less than this share of what the best so far leaves beyond noise. Of a UR10e whose elbow delivers 1.33
#: times the torque a set of nine numbers was ahead and left as much.
LESS: Final = 0.6
#: What each number of a set has to gain [nats].
PRICE: Final = ranking.MIN_EVIDENCE_GAIN_NATS


@dataclass(frozen=True)
class Columns:
    """Responses of torques to some effects, after the nominal numbers took their share of them.

    Attributes:
        parts: of each column; a load has one for its mass and one for each of its moments.
        curvature: (k, k), of half the sum of squares of the whitened residual [nats].
        gradient: (k,).
        room: bounds of each column's number, (2, k), from its value without effect.
    """

    parts: tuple[Candidate, ...]
    curvature: Array
    gradient: Array
    room: Array

    def of(self, effects: Sequence[str]) -> tuple[list[int], Array, float]:
        """The columns of some effects, their least-squares numbers within bounds, and what these gain [nats]."""
        kept = [k for k, part in enumerate(self.parts) if part.effect in effects]
        inner, gradient = self.curvature[np.ix_(kept, kept)], self.gradient[kept]
        scale = 1 / np.sqrt(np.maximum(np.diag(inner), 1e-300))
        normal = Normal(
            inner * np.outer(scale, scale) + 1e-9 * np.eye(len(kept)), gradient * scale, scale, self.room[:, kept]
        )
        step = normal.step()
        return kept, step, float(gradient @ step - 0.5 * step @ inner @ step)


def found(state: State) -> list[Fitted]:
    """The sets of :func:`explained`, where they are worth it."""
    return worth_it(state, explained(state))


def worth_it(state: State, sets: Sequence[Fitted]) -> list[Fitted]:
    """Explanations by sets of effects, where the best of them is far ahead of the best explanation so far, which is
    simpler, and leaves much less; else none."""
    (best,) = state.full.fit_all([starts.restart(state.best)])
    leader = max(sets, key=lambda fit: fit.evidence, default=best)
    less = ranking.discrepancy(leader) - 1 < LESS * (ranking.discrepancy(best) - 1)
    return list(sets) if less and leader.evidence > best.evidence + AHEAD_NATS else []


def explained(state: State) -> list[Fitted]:
    """Explanations of all trials by sets of effects, without what is needless in them: of one effect, and of one more
    as long as these leave a gap. One with a magnitude at the bound of what is possible stands for something else, and
    is left out."""
    full, least, out = state.full, ranking.least_deviations(replays=False), []
    for start in proposed(full, Point((), np.zeros(0), state.nominal_nuisance), state.pool):
        (fit,) = full.fit_all([start])
        needed = on_each.without_needless(full, mounting.placed_again(full, fit), least)
        out += [one for one in needed if not _at_edge(one)]
        if not ranking.leaves_a_gap(needed[0], replays=False):
            break
    return out


def _at_edge(fit: Fitted) -> bool:
    """Whether a magnitude lies at the bound of what is possible."""
    return any(part.at_edge(float(value)) for part, value in zip(fit.parts, fit.values, strict=True))


def proposed(fitter: Fitter, point: Point, pool: Sequence[Candidate]) -> list[Start]:
    """Starts with the set of effects that gains most of each size, each effect on every target with a number of its
    own; the smallest first.

    Args:
        fitter: of all trials.
        point: the nominal model, with its numbers.
        pool: candidates.
    """
    chosen = _one_of_each(pool)
    if not chosen:
        return []
    names = list(dict.fromkeys(part.effect for part in chosen))
    columns, out = _columns(fitter, point, chosen), []
    for size in range(1, min(MOST, len(names)) + 1):
        gains = []
        for effects in itertools.combinations(names, size):
            kept, _, gain = columns.of(effects)
            gains.append((gain - PRICE * len(kept), effects))
        start = _start(columns, max(gains)[1], point)
        out += [] if start is None else [start]
    return out


def _one_of_each(pool: Sequence[Candidate]) -> list[Candidate]:
    """Of every effect its candidates on single targets, or on all where it has none, in its usual form."""
    alone: dict[object, Candidate] = {}
    for part in pool:
        if np.isfinite(part.identity) and placing.without_place(part) == part:
            alone.setdefault(part.label, part)
    split = {part.effect for part in alone.values() if part.target is not None}
    return [part for part in alone.values() if part.target is not None or part.effect not in split]


def _smallest(part: Candidate) -> float:
    """The magnitude that is tried nearest to none."""
    return min(part.grid, key=lambda value: abs(value - part.identity))


def _columns(fitter: Fitter, point: Point, parts: Sequence[Candidate]) -> Columns:
    """Responses of some candidates beside the nominal model, whitened; the nominal numbers, whose priors count, are
    eliminated by their Schur complement."""
    on = Whitening(fitter.data, fitter.weight)
    sizes = [_smallest(part) for part in parts]
    base, *beside = fitter.predictions([point, *(point.with_effect(p, v) for p, v in zip(parts, sizes, strict=True))])
    wanted = on.white(likelihood.residual(fitter.data, base))
    of_parts: list[Candidate] = []
    columns, room, known = [], [], []
    for part, value, one in zip(parts, sizes, beside, strict=True):
        coordinates = placing.details(part.effect)
        reach = [part.high * d.bounds[1] for d in coordinates]
        changes = on.white((one - base) / (value - part.identity))[None]
        if coordinates:
            changes = mounting.changes(fitter, point, part)[0][:, : 1 + len(coordinates)].T
        columns.append(changes)
        of_parts += [part] * len(changes)
        room += [(part.low - part.identity, part.high - part.identity), *((-np.inf, np.inf) for _ in reach)]
        known += [0.0, *(1 / x**2 for x in reach)]
    effects, terms = np.concatenate(columns).T, on.columns(fitter.responses, fitter.per_trial)
    inner = terms.T @ terms + np.eye(terms.shape[1])
    shares = np.linalg.solve(inner, terms.T @ np.column_stack([effects, wanted]))
    left = effects.T @ (np.column_stack([effects, wanted]) - terms @ shares)
    return Columns(tuple(of_parts), left[:, :-1] + np.diag(known), left[:, -1], np.array(room).T)


def _start(columns: Columns, effects: Sequence[str], point: Point) -> Start | None:
    """A start at the least-squares numbers of some effects; None where a load has no mass to be placed."""
    kept, numbers, _ = columns.of(effects)
    of: dict[Candidate, list[float]] = {}
    for k, number in zip(kept, numbers, strict=True):
        of.setdefault(columns.parts[k], []).append(float(number))
    parts, values = [], []
    for part, (number, *moments) in of.items():
        if moments and abs(number) < mounting.LEAST_SHARE * (part.high - part.low):  # nothing to place
            return None
        parts.append(mounting.at_moments(part, number, moments) if moments else part)
        values.append(part.identity + number)
    return Start(tuple(parts), np.array(values), point.nuisance)
