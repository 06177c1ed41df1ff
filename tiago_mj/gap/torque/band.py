"""The cut-off of the low-pass: of several the one at which efforts tell most of what joints do.

A high cut-off keeps what is fast, and with it the noise of positions that were differentiated twice; a low one leaves
few independent rows. What counts is the Fisher information on an offset, dry friction, damping and inertia of every
joint, which all that is looked for resembles: its log determinant is the volume in which these four can lie (D-optimal
design; Pukelsheim 2006, chapter 6).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tiago_mj.gap.inference import hypotheses
from tiago_mj.gap.simulation import sizes
from tiago_mj.gap.simulation.session import FITTED, Session
from tiago_mj.gap.torque.channels import Wanted
from tiago_mj.gap.torque.flexible import left
from tiago_mj.gap.torque.measured import Array, Measured, measured
from tiago_mj.gap.torque.shown import shown
from tiago_mj.gap.torque.strips import HEADROOMS
from tiago_mj.io.deadline import OutOfTimeError
from tiago_mj.recordings.recording import RecordingError, Trial
from tiago_mj.recordings.trials import ENOUGH


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
    for k, headroom in enumerate(HEADROOMS):
        tick("comparing torques", len(HEADROOMS), k)
        try:
            one = measured(session, trials, wanted, headroom)
        except (RecordingError, OutOfTimeError):
            if not found:
                raise
            break  # too short a recording for so long a filter, or no time for it
        if found and (one.course.channels != found[0].course.channels or len(one.session.trials) < ENOUGH):
            break  # with fewer parts nothing is left to judge by
        plant = one.session.plant
        pool = shown(
            hypotheses.candidates(plant, None, None, sizes.sizes(plant, one.session.trials, one.motion)),
            one.predict.torques,
        )
        remains, data = left(one.predict, one.session.subset(*FITTED), pool), one.predict.data
        known, assumed = (replace(data, sigma=np.maximum(data.sigma, s)) for s in (remains.spread, remains.unseen))
        found.append(replace(one, predict=replace(one.predict, data=known), assumed=assumed))
        told.append(information(found[-1], 1 / remains.rows))
    return found[int(np.argmax(told))]


def information(one: Measured, independent: Array) -> float:
    """Log determinant of the Fisher information on offset, dry friction, damping and inertia, over all channels.

    Args:
        one: trials at a cut-off.
        independent: share of the rows of each channel that are independent, (C,).
    """
    data, every = one.predict.data, one.predict.every
    total = np.zeros((len(data.channels), 4, 4))
    for trial, torques in enumerate(one.predict.torques):
        course = torques.course
        velocity, acceleration = course.stack("velocity"), course.stack("acceleration")
        for c, j in enumerate(course.columns):
            direction = np.clip(velocity[:, j] / course.rest_speed[j], -1, 1)
            columns = np.stack([np.ones_like(direction), direction, velocity[:, j], acceleration[:, j]], axis=1)
            kept = course.filtered(columns)[::every]
            known = np.isfinite(data.value[trial, : len(kept), c])
            white: Array = kept[known] / data.sigma[trial, 0, c]
            total[c] += independent[c] * white.T @ white
    signs, sizes = np.linalg.slogdet(total)
    return float(np.where(signs > 0, sizes, -np.inf).sum())
