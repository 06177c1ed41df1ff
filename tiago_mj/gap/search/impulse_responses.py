"""Impulse responses of joints to a set point that is off for one row, estimated beside an explanation.

A response is linear and time-invariant: it is estimated by regression from a simulation in which some commands are lost
at random.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.detectors.set_points import ServoMotion
from tiago_mj.gap.inference.predictor import Effects, Predictor

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: The effect that loses commands.
LOSES: Final = next(name for name, declared in EFFECTS.items() if declared.loses_commands)
#: Share of commands lost in the simulations from which the joints' responses are learned, and their seed.
TRAINING_SHARE: Final = 0.15
SEED: Final = 15
#: Strength of the ridge prior towards a first-order response (share of the mean square of the set points). Halved
#: and doubled, none of 15 answers about hinges changes (varied.json).
RIDGE: Final = 0.01
#: Length of a learned response in time constants, and fewest and most rows of it. Halved and doubled, none of 32
#: answers about hinges changes (varied.json).
RESPONSE_TIME_CONSTANTS: Final = 5.0
RESPONSE_ROWS: Final = (3, 60)


@dataclass(frozen=True)
class ServoCommands:
    """Commands to one servo and their periods, (ntrials, T - 1), the set point before the first command, (ntrials,),
    and whether commands are velocities."""

    sent: Array
    period: Array
    start: Array
    velocity: bool

    @property
    def initial(self) -> Array:
        """Set point before the first command, (ntrials,)."""
        return np.zeros_like(self.start) if self.velocity else self.start

    def at(self, trials: Sequence[int]) -> ServoCommands:
        """Of some trials."""
        index = list(trials)
        return replace(self, sent=self.sent[index], period=self.period[index], start=self.start[index])

    def set_point_offsets(self, delivered: Array) -> Array:
        """Difference that lost commands make to the set point, (ntrials, T - 1)."""
        held, off = self.initial, np.zeros(self.sent.shape)
        for k in range(self.sent.shape[1]):
            held = np.where(delivered[:, k] == 0, held, self.sent[:, k])
            off[:, k] = held - self.sent[:, k]
        return np.cumsum(off * self.period, axis=1) if self.velocity else off


def _impulse_responses(offsets: Array, change: Array, known: Mask, prior: Sequence[Array]) -> Array:
    """Impulse response of every channel to a set point that is off for one row, (C, rows), by ridge regression."""
    rows = len(prior[0])
    padded = np.pad(offsets, ((0, 0), (rows - 1, 0)))
    before = np.lib.stride_tricks.sliding_window_view(padded, rows, axis=1)[:, :, ::-1]
    out = []
    for c, expected in enumerate(prior):
        use = known[:, :, c]
        x, y = before[use], change[:, :, c][use]
        square = x.T @ x
        square += (RIDGE * np.trace(square) / rows + 1e-12) * np.eye(rows)
        out.append(expected + np.linalg.solve(square, x.T @ (y - x @ expected)))
    return np.array(out)


@dataclass(frozen=True)
class Learned:
    """Change of the predictions in a simulation in which some commands are lost at random.

    Attributes:
        predict: simulations.
        delivered: 0 for a command that is lost there, (ntrials, T - 1, nactuators).
        change: of the channels, (ntrials, T, C).
    """

    predict: Predictor
    delivered: Array
    change: Array

    def of(
        self, motion: ServoMotion, actuator: int, channels: Sequence[int], known: Mask, *, late: bool = False
    ) -> tuple[ServoCommands, Array]:
        """Commands to a servo, and the impulse responses of some channels to its set point, (C, rows).

        Args:
            motion: of the servos.
            actuator: its index.
            channels: of its joint, by index.
            known: where they tell something, (ntrials, T - 1, C).
            late: whether the answer may come later than the nominal model's.
        """
        plant, on = self.predict.plant, self.predict.on
        servo = ServoCommands(
            on.commands[:, :, actuator],
            on.period,
            motion.start[:, actuator],
            plant.wiring.interface == "velocity",
        )
        share = min(float(motion.share[actuator]), 0.99)
        rows = int(np.clip(np.ceil(-RESPONSE_TIME_CONSTANTS / np.log1p(-share)) + RESPONSE_ROWS[0], *RESPONSE_ROWS))
        rows = RESPONSE_ROWS[1] if late else rows
        usual = share * (1 - share) ** np.arange(rows)
        of_first_order = {"position": usual, "velocity": np.diff(usual, prepend=0.0) / plant.period}
        prior = [np.asarray(of_first_order[self.predict.data.kinds[c]]) for c in channels]
        offsets = servo.set_point_offsets(self.delivered[:, :, actuator])
        return servo, _impulse_responses(offsets, self.change[:, 1:, channels], known, prior)


def learned(predict: Predictor, effects: Sequence[Effects]) -> tuple[Array, Learned]:
    """Predictions of all trials, (ntrials, T, C), and their change when commands are lost at random.

    Args:
        predict: simulations.
        effects: beside which commands are lost, of every trial.
    """
    everything = range(len(predict.on.trials))
    base = predict([(t, effects[t]) for t in everything])
    delivered = (np.random.default_rng(SEED).random(predict.on.commands.shape) > TRAINING_SHARE).astype(float)
    losing = Entry(LOSES, None, {"probability": TRAINING_SHARE})
    there = predict.with_delivered(delivered)([(t, (*effects[t], losing)) for t in everything])
    return base, Learned(predict, delivered, there - base)
