"""The cut-off of the low-pass: of several the one at which efforts tell most of what joints do.

A high cut-off keeps what is fast, and with it the noise of positions that were differentiated twice; a low one leaves
few independent rows. What counts is the Fisher information on an offset, dry friction, damping and inertia of every
joint, which all that is looked for resembles: its log determinant is the volume in which these four can lie (D-optimal
design; Pukelsheim 2006, chapter 6).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tiago_mj.gap.inference import hypotheses
from tiago_mj.gap.simulation import sizes
from tiago_mj.gap.simulation.session import FITTED, Session
from tiago_mj.gap.torque.channels import Wanted
from tiago_mj.gap.torque.flexible import left
from tiago_mj.gap.torque.measured import Array, Measured, known_at_best, measured
from tiago_mj.gap.torque.second_numbers import with_second_numbers
from tiago_mj.gap.torque.shown import shown
from tiago_mj.io.deadline import OutOfTimeError
from tiago_mj.recordings.recording import RecordingError, Trial
from tiago_mj.recordings.trials import ENOUGH

#: Offset, dry friction, damping and inertia.
NUMBERS: Final = 4
#: Cut-offs that are tried, as shares of the highest, and how many tell less in a row before no lower one is tried.
SHARES: Final = tuple(0.5**k for k in range(7))
FALLS: Final = 2
#: Of cut-offs at which the deviations of the four numbers are alike to this share, the lowest is taken: what no model
#: has, a gear's teeth or a link that swings, is fast. A double pendulum's friction is told by two bands alike, and the
#: faster one tempts to a torque constant beside it. Varied: with 0, 0.025, 0.05 and 0.1 the cut-off is the same in 24
#: of 26 real recordings and in 80 blind ones (seeds 65, 66), with 0.2 in 17 and in 78.
ALIKE: Final = 0.1


def most_informative(
    session: Session,
    trials: Sequence[Trial],
    wanted: Wanted,
    tick: Callable[[str, int, int], None] = lambda stage, total, done: None,
) -> Measured:
    """Trials at the cut-off that tells most; arguments as of :func:`tiago_mj.gap.torque.measured.measured`.

    Args:
        tick: told how many cut-offs there are to try, and how many were.

    Raises:
        OutOfTimeError: the deadline is over at the highest cut-off.
        RecordingError: nothing moves, or as :func:`~tiago_mj.gap.torque.measured.measured` does at the highest cut-off.
        ValueError: the model lacks a joint.
    """
    if not any(
        np.nanmax(p) > np.nanmin(p) for trial in trials for p in trial.positions.values() if np.isfinite(p).any()
    ):
        raise RecordingError(f"{trials[0].source}: no joint moves: torque along a motion needs a motion")
    found: list[Measured] = []
    told: list[float] = []
    for k, share in enumerate(SHARES):
        tick("comparing torques", len(SHARES), k)
        try:
            one = measured(session, trials, wanted, share)
        except (RecordingError, OutOfTimeError):
            if not found:
                raise
            break  # too short a recording for so long a filter, or no time for it
        if found and (one.course.channels != found[0].course.channels or len(one.session.trials) < ENOUGH):
            break  # with fewer parts nothing is left to judge by
        plant = one.session.plant
        some, data = one.session.subset(*FITTED), one.predict.data
        pool = hypotheses.candidates(plant, None, None, sizes.sizes(plant, one.session.trials, one.motion))
        pool = with_second_numbers(shown(pool, one.predict.torques), one.predict, some)
        remains = left(one.predict, some, pool)
        known, assumed = (known_at_best(data, s) for s in (remains.spread, remains.unseen))
        found.append(replace(one, predict=replace(one.predict, data=known), assumed=assumed))
        told.append(information(found[-1], 1 / remains.rows))
        if k - int(np.argmax(told)) >= FALLS:
            break
    least = max(told) - 2 * NUMBERS * len(found[0].predict.data.channels) * np.log1p(ALIKE)
    return found[max(k for k, each in enumerate(told) if each >= least)]


def information(one: Measured, independent: Array) -> float:
    """Log determinant of the Fisher information on offset, dry friction, damping and inertia, over all channels.

    Args:
        one: trials at a cut-off.
        independent: share of the rows of each channel that are independent, (C,).
    """
    data, every = one.predict.data, one.predict.every
    total = np.zeros((len(data.channels), NUMBERS, NUMBERS))
    for trial, torques in enumerate(one.predict.torques):
        course = torques.course
        velocity, acceleration = course.stack("velocity"), course.stack("acceleration")
        for c, j in enumerate(course.columns):
            direction = np.clip(velocity[:, j] / course.rest_speed[j], -1, 1)
            columns = np.stack([np.ones_like(direction), direction, velocity[:, j], acceleration[:, j]], axis=1)
            kept = course.filtered(columns)[::every]
            known = np.isfinite(data.value[trial, : len(kept), c])
            white: Array = kept[known] / data.sigma[trial, : len(kept), c][known, None]
            total[c] += independent[c] * white.T @ white
    signs, sizes = np.linalg.slogdet(total)
    return float(np.where(signs > 0, sizes, -np.inf).sum())
