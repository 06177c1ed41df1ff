"""Output of all detectors, before anything is fitted: candidates with starting magnitudes, and effects that need no
fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.detectors import readings, ripples, set_points, swings
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.simulation.replay import Signals

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Proposals:
    """Candidates and measured effects with which a search begins.

    Attributes:
        pool: effects to consider, with the magnitudes that the detectors point to among those that are tried.
        known: effects that the readings show by themselves (a grid, repeats, drift at rest), with their values.
        servo_motion: what the servos' motion says of their set points; None where it says nothing.
        tones: hum of load cells, which no effect of the library explains.
        data: what was measured, without what is only a repeat.
    """

    pool: tuple[Candidate, ...]
    known: tuple[readings.Known, ...]
    servo_motion: set_points.ServoMotion | None
    tones: tuple[readings.Tone, ...]
    data: Data


def proposals(
    predict: Predictor, nominal: Signals, base: Array, pool: Sequence[Candidate], trials: Sequence[int]
) -> Proposals:
    """Run every detector on the recordings.

    Args:
        predict: simulations, with the plant and what was measured.
        nominal: the nominal replay, one row a trial.
        base: nominal prediction of every trial, (ntrials, T, C).
        pool: effects to consider.
        trials: indices of those that may be looked at: not those that are kept aside.

    Raises:
        OutOfTimeError: the predictor's deadline is over.
    """
    plant, on, data, some = predict.plant, predict.on, predict.data, list(trials)
    part = noise_model.select_trials(data, some)
    motion = set_points.servo_motion(plant, on, data, nominal)
    if motion is not None:
        pool = set_points.magnitudes(plant, on, motion, pool, some, predict.deadline)
    predict.deadline.check()
    untouched = set_points.untouched(data, nominal, data.value.shape[1])
    share = set_points.shares(plant, motion)
    pool = ripples.with_periods(plant, part, base[some], untouched[some], share, pool)
    pool = swings.with_frequencies(part, base[some], plant.period, pool)
    tones = readings.tones(plant, data, base)
    hums = {tone.channel for tone in tones}
    marks = [mark for mark in readings.of_channels(plant, part, base[some]) if mark.channel not in hums]
    known = readings.measured_on_readings(marks, pool)
    if any(EFFECTS[one.candidate.effect].shows_as == "repeats" for one in known):  # a repeat tells nothing new
        data = noise_model.without_repeats(data)
    return Proposals(tuple(pool), tuple(known), motion, tuple(tones), data)
