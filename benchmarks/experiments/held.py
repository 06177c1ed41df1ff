"""Ways of a dead band: which commands were held, by the same algorithm as which were lost."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.search import lost_commands

Array = NDArray[np.float64]

#: A command that is farther from what is held than the width passes, nearer ones do not: but for so many, and within so
#: much of the width either way it is undecided. Real drivers look at instants of their own.
MISTAKEN: Final = 0.005
SOFT: Final = 0.15


def held_ways(way: Any, answers: Array, residual: Array, precision: Array, width: float) -> float:
    """Cost of all ways in which commands were held within a dead band [nats], of one servo over trials.

    Args:
        way: what the servo is sent, of positions.
        answers: of its channels to a set point that is off for a row, (C, rows).
        residual, precision: measured minus predicted, and one over its variance, (ntrials, T, C).
        width: of the dead band.
    """
    (trials, length), states = way.sent.shape, 1 << lost_commands.STATE_COMMANDS
    new = np.arange(states)
    stays = (new & 1).astype(bool)
    shape = (trials, states)
    cost, together = np.full(shape, np.inf), np.full(shape, np.inf)
    cost[:, 0] = together[:, 0] = 0.0
    held = np.broadcast_to(way.start[:, None], shape)
    memory, slow = np.zeros((*shape, answers.shape[1])), np.zeros((*shape, len(answers)))
    before = (new >> 1, (new >> 1) | (states >> 1))
    for k in range(length):
        sent = way.sent[:, k, None]
        ways = []
        for old in before:
            was = held[:, old]
            passes = 1 / (1 + np.exp(-np.clip((np.abs(sent - was) - width) / (SOFT * width), -50, 50)))
            passes = MISTAKEN + (1 - 2 * MISTAKEN) * passes
            drawn = np.where(stays, -np.log1p(-passes), -np.log(passes))
            now = np.where(stays, was, sent)
            kept = np.concatenate([(now - sent)[..., None], memory[:, old, :-1]], axis=-1)
            left = residual[:, k, None] - kept @ answers.T - slow[:, old]
            said, drift = lost_commands._row_cost(
                left, precision[:, k, None], answers.shape[1], lost_commands.DECODING_SAMPLE_WEIGHT
            )
            step = said + drawn
            ways.append((cost[:, old] + step, together[:, old] + step, now, kept, slow[:, old] + drift))
        second = ways[1][0] < ways[0][0]
        together = -np.logaddexp(-ways[0][1], -ways[1][1])
        cost, held = (np.where(second, ways[1][i], ways[0][i]) for i in (0, 2))
        memory, slow = (np.where(second[..., None], ways[1][i], ways[0][i]) for i in (3, 4))
    return float(-np.logaddexp.reduce(-together, axis=-1).sum())
