"""Lost commands, decoded from the motion of the servos by Viterbi's algorithm.

When a command is lost, the previous one stays in force, so the executed set point differs from the commanded one for a
while. The joint's impulse response to such a difference is estimated from simulations in which commands are lost at
random. The commands lost in a recording are then decoded from the residuals by Viterbi's algorithm, whose state is
which of the last few commands were lost; each path keeps its own memory (per-survivor processing; Raheli, Polydoros &
Tzou 1995). The likelihood summed over all paths gives the share of lost commands. Compared with the likelihood of the
chosen path, it also gives the penalty for having chosen that path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.detectors import set_points
from tiago_mj.gap.detectors.set_points import MAX_SQUARED_RESIDUAL, ServoMotion
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point
from tiago_mj.gap.inference.hypotheses import Candidate, Label
from tiago_mj.gap.inference.predictor import Effects, Predictor
from tiago_mj.gap.inference.remembered import remembered
from tiago_mj.gap.search import impulse_responses, ranking, starts
from tiago_mj.gap.search.impulse_responses import LOSES, ServoCommands

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

EFFECT: Final = LOSES
#: Shares of lost commands that are looked at.
SHARES: Final = tuple(np.geomspace(0.01, 0.5, 7).tolist())
#: Rounds of decoding and fitting at most, Gauss-Newton steps of each fit, and ratio of a round's cost to the last
#: one's above which the rounds end. Halved and doubled, none of 48 answers about hinges changes (varied.json).
MAX_DECODING_ROUNDS: Final = 6
FIT_ITERATIONS: Final = 2
CONVERGED_COST_RATIO: Final = 0.97
#: Of a nuisance that takes up what lost commands do, the shares beside which commands are decoded in every round.
#: Without the second, 7 % were found of 15 % that a hinge lost at 240 Hz (seed 5254), with it 13 %.
TAKEN_UP: Final = (1.0, 0.5)
#: Number of latest commands that a state of the Viterbi decoder holds. Halved and doubled, none of 16 answers about
#: hinges changes (varied.json).
STATE_COMMANDS: Final = 5
#: Time constant of the estimate of slow errors, in lengths of a response: what errs for longer is no lost command.
#: Halved and doubled, none of 15 answers about hinges changes (varied.json).
DRIFT_RESPONSES: Final = 3.0
#: Weight of a sample while commands are decoded: as elsewhere, but for its correlation in time.
DECODING_SAMPLE_WEIGHT: Final = 1 / ranking.SAMPLES_PER_INDEPENDENT
#: Lost commands are not pursued where their cost exceeds this share of the cost without losses. Halved and doubled,
#: none of 15 answers about hinges changes (varied.json).
MAX_COST_RATIO: Final = 0.85
#: Beside the best single effect it was 0.54 and 0.65 where commands were lost, 0.82 where few servos could show it, and
#: 0.88 to 1 where none was; once 0.58, where a speed was limited.
LIKELY_COST_RATIO: Final = 0.7
#: The same with the sample weights of the fit. Halved and doubled, none of 16 answers about hinges changes
#: (varied.json).
MAX_WEIGHTED_COST_RATIO: Final = 0.7
#: Standard deviation of the share of lost commands due to wrong decoding, relative to the share. Halved and doubled,
#: none of 16 answers about hinges changes (varied.json).
RELATIVE_DECODING_ERROR: Final = 0.2
#: Fewest lost commands, and smallest gain of log-likelihood [nats], at which lost commands are a candidate. Halved
#: and doubled, none of 32 answers about hinges changes (varied.json).
MIN_LOST: Final = 4
MIN_GAIN_NATS: Final = 10.0


@dataclass(frozen=True)
class DecodedLosses:
    """Lost commands as decoded from the recordings, with the likelihood of each share.

    Attributes:
        delivered: 0 for a command that was lost, 1 for others, (ntrials, T - 1, nactuators).
        cost: negative log-likelihood for each share, summed over all paths, (nshares, ntrials, nactuators) [nats].
        none: negative log-likelihood if no command is lost, (ntrials, nactuators) [nats].
        chosen: negative log-likelihood of the residuals on the chosen path, without that path's own prior probability,
            (ntrials, nactuators) [nats].
        best: index of the share that was chosen, (nactuators,).
    """

    delivered: Array
    cost: Array
    none: Array
    chosen: Array
    best: NDArray[np.int_]

    def cost_with_losses(self, trials: Sequence[int]) -> float:
        """Negative log likelihood of some trials with every servo at its share of losses [nats]."""
        some = list(trials)
        return float(sum(self.cost[k, some, a].sum() for a, k in enumerate(self.best)))

    def cost_without_losses(self, trials: Sequence[int]) -> float:
        """Negative log likelihood of some trials without losses [nats]."""
        return float(self.none[list(trials)].sum())


@dataclass(frozen=True)
class ExplanationWithLosses:
    """An explanation fitted with the commands that were lost beside it.

    Attributes:
        predict: simulations that lose them.
        found: which they are.
        point: the explanation without them.
        fit: with them.
    """

    predict: Predictor
    found: DecodedLosses
    point: Point
    fit: Fitted


def are_likely(fitter: Fitter, best: Fitted, motion: ServoMotion) -> bool:
    """Whether a first decoding (two simulations of every trial) explains so much of the residual of the liveliest
    trials that lost commands are fitted before a second effect is sought."""
    trials = set_points.liveliest_trials(motion, fitter.acting_trials)
    found = decode(fitter.predict, motion, effects_in_every_trial(fitter, Point.of(best)), trials, of=trials)
    return found.cost_with_losses(trials) < LIKELY_COST_RATIO * found.cost_without_losses(trials)


def decoded_beside(
    fitter: Fitter, linearization_point: Point, motion: ServoMotion, pool: Sequence[Candidate]
) -> ExplanationWithLosses | None:
    """Commands that were lost beside an explanation without losses; None where hardly any was.

    Where trials have many rows, losses and explanation are fitted to the liveliest first, and to all from there on.

    Args:
        fitter: of the trials that are explained.
        linearization_point: the explanation.
        motion: of the servos.
        pool: candidates that lose commands, the first of them to all servos.
    """
    first, there = set_points.liveliest_trials(motion, fitter.acting_trials), linearization_point
    if len(first) == len(fitter.acting_trials):
        return _alternating(fitter, _beginnings(fitter, there), motion, pool, None)
    rows = fitter.trials.rows_of(first)
    part = fitter.part(rows)
    near = replace(there, nuisance=fitter.of(rows, there.nuisance))
    few = _alternating(part, _beginnings(part, near), motion, pool, first)
    if few is None or fitter.out_of_time():
        return None
    shared = len(fitter.shared)
    nuisance = np.concatenate([few.fit.nuisance[:shared], there.nuisance[shared:]])
    begin = Point(few.fit.parts, few.fit.values, nuisance).without_effect(len(few.fit.parts) - 1)
    return _alternating(fitter, [begin], motion, pool, None)


def _beginnings(fitter: Fitter, point: Point) -> list[Point]:
    """A point, without those of its nuisances that may have absorbed what lost commands do, above all the delay, and
    without any."""
    none = np.zeros(fitter.size)
    some = (point.nuisance, np.where(_takes_up(fitter), 0.0, point.nuisance), none)
    return [replace(point, nuisance=nuisance) for nuisance in {one.tobytes(): one for one in some}.values()]


def _takes_up(fitter: Fitter) -> Mask:
    """Mask of the nuisances that take up what lost commands do, (size,)."""
    out = np.zeros(fitter.size, dtype=bool)
    for k, term in enumerate(fitter.terms):
        out[fitter.nuisance_indices(k)] = term.effect in EFFECTS[LOSES].taken_up_by
    return out


def _alternating(
    fitter: Fitter, begin: Sequence[Point], motion: ServoMotion, pool: Sequence[Candidate], of: Sequence[int] | None
) -> ExplanationWithLosses | None:
    """Decoding and fitting in turns, from several points; ``of``: trials that are decoded, None for all."""
    takes_up, trials = _takes_up(fitter), fitter.acting_trials
    best, least = None, np.inf
    for point in begin:
        before = np.inf
        for _ in range(MAX_DECODING_ROUNDS):
            if fitter.out_of_time():
                return best
            tried = [
                (decode(fitter.predict, motion, effects_in_every_trial(fitter, near), trials, of=of), near)
                for near in _with_less(point, takes_up)
            ]
            found, point = min(tried, key=lambda one: one[0].cost_with_losses(trials))
            losing = losing_candidates(pool, found, fitter.predict.plant.wiring.targets.command, trials)
            now = found.cost_with_losses(trials)
            if losing is None or now > MAX_COST_RATIO * found.cost_without_losses(trials):
                break
            predict = fitter.predict.with_delivered(found.delivered)
            there = point.with_effect(losing[0], losing[0].grid[0])
            (fit,) = replace(fitter, predict=predict, iterations=FIT_ITERATIONS).fit_all([starts.start_at(there)])
            if now < least:
                best, least = ExplanationWithLosses(predict, found, point, fit), now
            if now > CONVERGED_COST_RATIO * before:
                break
            before = now
            point = Point(fit.parts, fit.values, fit.nuisance).without_effect(len(fit.parts) - 1)
    return best


def _with_less(point: Point, takes_up: Mask) -> list[Point]:
    """A point, and with less of the nuisance parameters that take up what lost commands do.

    Given which commands were lost, such a nuisance is at its optimum, and given the nuisance so are the commands: one
    after the other they stop between too few losses and too late a servo.
    """
    shares = np.unique(np.where(takes_up[None], np.array(TAKEN_UP)[:, None] * point.nuisance, point.nuisance), axis=0)
    return [replace(point, nuisance=nuisance) for nuisance in shares]


def penalised(
    fitter: Fitter, decoded: ExplanationWithLosses, motion: ServoMotion, pool: Sequence[Candidate]
) -> dict[Label, Candidate] | None:
    """Candidates for lost commands, by label, with the share that was lost and the penalty for decoding which ones
    were.

    The penalty of a trial is the log likelihood of the executed set points, by Viterbi's algorithm, minus that summed
    over all paths, and at least 0. Both use the fit's weight of a sample, which is smaller than the weight used for
    decoding where errors are correlated. None where lost commands explain too little.

    Args:
        fitter: of the trials that are explained, with what a sample counts for.
        decoded: of the same trials.
        motion: of the servos.
        pool: candidates.
    """
    counts, trials = fitter.motion_counts, fitter.acting_trials
    effects = effects_in_every_trial(fitter, decoded.point)
    some = decode(fitter.predict, motion, effects, trials, counts)
    none, least = some.cost_without_losses(trials), some.cost_with_losses(trials)
    commands = fitter.predict.plant.wiring.targets.command
    losing = losing_candidates(pool, decoded.found, commands, trials)
    if losing is None or none - least < MIN_GAIN_NATS or least > MAX_WEIGHTED_COST_RATIO * none:
        return None
    out = {}
    for candidate in losing:
        index = [commands.index(name) for name in candidate.target or commands]
        all_paths = np.stack([some.cost[some.best[a], :, a] for a in index], axis=-1)
        excess = all_paths - counts / DECODING_SAMPLE_WEIGHT * decoded.found.chosen[:, index]
        penalty = np.maximum(excess, 0.0).sum(axis=1) / counts
        out[candidate.label] = replace(candidate, selection_penalty=tuple(penalty.tolist()))
    return out


def effects_in_every_trial(fitter: Fitter, linearization_point: Point) -> list[Effects]:
    """Effects of a point for every trial, those included that are not fitted."""
    elsewhere = linearization_point.nuisance.copy()
    elsewhere[len(fitter.shared) :] = 0.0
    out = [fitter.effects(linearization_point.parts, linearization_point.values, elsewhere, 0)] * len(
        fitter.predict.on.trials
    )
    for k, trial in enumerate(fitter.trials):
        out[trial] = fitter.effects(
            linearization_point.parts, linearization_point.values, linearization_point.nuisance, k
        )
    return out


def decode(
    predict: Predictor,
    motion: ServoMotion,
    effects: Sequence[Effects],
    fitted_on: Sequence[int],
    counts: float = DECODING_SAMPLE_WEIGHT,
    of: Sequence[int] | None = None,
) -> DecodedLosses:
    """Lost commands of every trial, or of some, and the share lost by every servo, by maximum likelihood.

    Args:
        predict: simulations.
        motion: of the servos.
        effects: beside which commands may be lost, of every trial.
        fitted_on: trials by which the share is chosen.
        counts: what a sample counts for.
        of: trials that are decoded, ``fitted_on`` among them; None: all. Of the others no command is lost, at no cost.
    """
    decoded = list(range(len(predict.on.trials)) if of is None else of)

    def work() -> tuple[Any, ...]:
        return _decoded(predict, motion, effects, fitted_on, counts, decoded)

    depends_on = ("lost commands", list(effects), list(fitted_on), counts, decoded)
    return DecodedLosses(*remembered(predict, work, depends_on, lambda: False))


def _decoded(
    predict: Predictor,
    motion: ServoMotion,
    effects: Sequence[Effects],
    fitted_on: Sequence[int],
    counts: float,
    of: list[int],
) -> tuple[Any, ...]:
    """Fields of :class:`DecodedLosses`, as of :func:`decode`."""
    plant, on, data = predict.plant, predict.on, predict.data
    base, learned = impulse_responses.learned(predict, effects)
    deviation = np.sqrt(np.maximum(data.sigma**2 - data.common**2, data.noise**2))
    actuated = plant.wiring.targets.actuated
    shape = (len(on.trials), len(actuated))
    found, cost = np.ones(on.commands.shape), np.zeros((len(SHARES), *shape))
    none, chosen, best = np.zeros(shape), np.zeros(shape), np.zeros(len(actuated), dtype=int)
    for a, joint in enumerate(actuated):
        names = (f"position.{plant.joints[joint]}", f"velocity.{plant.joints[joint]}")
        mine = [c for c, name in enumerate(data.channels) if name in names]
        if not mine:
            continue  # nothing tells what this servo did
        known = np.isfinite(data.value[:, 1:, mine]) & np.isfinite(motion.deviation[:, 1:, a, None])
        precision = np.where(known, 1 / deviation[:, 1:, mine] ** 2, 0.0)
        residual = np.where(known, (data.value - base)[:, 1:, mine], 0.0)
        servo, response = learned.of(motion, a, mine, known)
        servo, residual, precision = servo.at(of), residual[of], precision[of]
        viterbi = _viterbi(servo, response, residual, precision, counts)
        cost[:, of, a] = viterbi.cost
        none[of, a] = _cost_without_losses(residual, precision, response.shape[1], counts)
        best[a] = k = int(np.argmin(cost[:, list(fitted_on), a].sum(axis=1)))
        found[of, :, a], chosen[of, a] = viterbi.delivered[k], viterbi.data[k]
    return found, cost, none, chosen, best


def losing_candidates(
    pool: Sequence[Candidate], lost: DecodedLosses, commands: Sequence[str], trials: Sequence[int]
) -> list[Candidate] | None:
    """Candidates of a pool that lose commands, with the decoded share; None where hardly any command was lost.

    Args:
        pool: candidates.
        lost: which were.
        commands: names of the actuators.
        trials: by which the share is told.
    """
    some = list(trials)
    if (lost.delivered[some] == 0).sum() < MIN_LOST or lost.cost_without_losses(some) - lost.cost_with_losses(
        some
    ) < MIN_GAIN_NATS:
        return None
    out = []
    for candidate in pool:
        if candidate.effect != EFFECT:
            continue
        index = [commands.index(name) for name in candidate.target or commands]
        value, spread = _likeliest_share(lost.cost[:, some][:, :, index].sum(axis=(1, 2)))
        out.append(replace(candidate, grid=(min(value, candidate.high),), spread=spread))
    return out


def _likeliest_share(cost: Array) -> tuple[float, float]:
    """Maximum-likelihood share, interpolated between those that were tried, and its standard deviation."""
    k = int(np.argmin(cost))
    if k in (0, len(cost) - 1):  # beyond what is looked at
        return SHARES[k], RELATIVE_DECODING_ERROR * SHARES[k]
    step = np.log(SHARES[1] / SHARES[0])
    bend = max(float(cost[k - 1] - 2 * cost[k] + cost[k + 1]), 1e-9)
    move = float(np.clip((cost[k - 1] - cost[k + 1]) / (2 * bend), -1.0, 1.0))
    value = float(SHARES[k] * np.exp(step * move))
    return value, value * float(np.hypot(min(step / np.sqrt(bend), 1.0), RELATIVE_DECODING_ERROR))


@dataclass(frozen=True)
class _ViterbiResult:
    """Cost summed over all paths and data cost of the best path by share and trial, (nshares, ntrials), and that path's
    delivered commands, (nshares, ntrials, T - 1)."""

    cost: Array
    data: Array
    delivered: Array


def _viterbi(servo: ServoCommands, answers: Array, residual: Array, precision: Array, counts: float) -> _ViterbiResult:
    """Most likely path and sum over all paths; a state is which of the last few commands were lost.

    Args:
        servo: what the servo is sent.
        answers: (C, rows).
        residual, precision: measured minus predicted, and one over its variance, after each command, (ntrials, T, C).
        counts: what a sample counts for.
    """
    (trials, length), states = servo.sent.shape, 1 << STATE_COMMANDS
    share = np.array(SHARES)[:, None, None]
    new = np.arange(states)
    lost = (new & 1).astype(bool)
    drawn = np.where(lost, -np.log(share), -np.log1p(-share))
    forbidden = np.where(lost, np.inf, 0.0)
    shape = (len(SHARES), trials, states)
    cost, all_paths, data = np.full(shape, np.inf), np.full(shape, np.inf), np.zeros(shape)
    cost[..., 0] = all_paths[..., 0] = 0.0
    held = np.broadcast_to(servo.initial[None, :, None], shape)
    memory, slow = np.zeros((*shape, answers.shape[1]), dtype=np.float32), np.zeros((*shape, len(answers)))
    answers = answers.astype(np.float32)
    second = np.zeros((length, *shape), dtype=bool)  # which of two states every state came from
    before = (new >> 1, (new >> 1) | (states >> 1))
    for k in range(length):
        sent = servo.sent[None, :, k, None]
        branches = []
        for old in before:
            was = held[:, :, old]
            now = np.where(lost, was, sent)
            off = now - sent
            if servo.velocity:
                off = memory[:, :, old, 0] + off * servo.period[None, :, k, None]
            kept = np.concatenate([off[..., None].astype(np.float32), memory[:, :, old, :-1]], axis=-1)
            left = residual[None, :, k, None] - kept @ answers.T - slow[:, :, old]
            row_cost, drift = _row_cost(left, precision[None, :, k, None], answers.shape[1], counts)
            step = row_cost + np.where(np.abs(sent - was) > 1e-9, drawn, forbidden)  # what repeats cannot be lost
            branches.append((cost[:, :, old] + step, all_paths[:, :, old] + step, data[:, :, old] + row_cost, now, kept,
                         slow[:, :, old] + drift))  # fmt: skip
        second[k] = branches[1][0] < branches[0][0]
        all_paths = -np.logaddexp(-branches[0][1], -branches[1][1])
        cost, data, held = (np.where(second[k], branches[1][i], branches[0][i]) for i in (0, 2, 3))
        memory, slow = (np.where(second[k][..., None], branches[1][i], branches[0][i]) for i in (4, 5))
    state = np.argmin(cost, axis=-1)
    best = np.take_along_axis(data, state[..., None], axis=-1)[..., 0]
    delivered = np.ones((*state.shape, length))
    for k in range(length - 1, -1, -1):
        delivered[:, :, k] = 1 - (state & 1)
        other = np.take_along_axis(second[k], state[..., None], axis=-1)[..., 0]
        state = np.where(other, before[1][state], before[0][state])
    return _ViterbiResult(-np.logaddexp.reduce(-all_paths, axis=-1), best, delivered)


def _row_cost(left: Array, precision: Array, rows: int, counts: float) -> tuple[Array, Array]:
    """Negative log likelihood of a row [nats], and its change to the estimate of the slowly varying error."""
    square = left**2 * precision
    clipped = np.minimum(1.0, np.sqrt(MAX_SQUARED_RESIDUAL / np.maximum(square, MAX_SQUARED_RESIDUAL)))
    drift = np.where(precision > 0, left * clipped / (DRIFT_RESPONSES * rows), 0.0)
    return counts / 2 * np.minimum(square, MAX_SQUARED_RESIDUAL).sum(axis=-1), drift


def _cost_without_losses(residual: Array, precision: Array, rows: int, counts: float) -> Array:
    """Negative log likelihood of every trial without losses, (ntrials,) [nats]."""
    total, slow = np.zeros(len(residual)), np.zeros((len(residual), residual.shape[2]))
    for k in range(residual.shape[1]):
        row_cost, drift = _row_cost(residual[:, k] - slow, precision[:, k], rows, counts)
        total, slow = total + row_cost, slow + drift
    return total
