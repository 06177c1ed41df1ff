"""Recordings beside the nominal model, whichever predictor they are compared by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.detectors.proposals import Proposals
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.simulation.replay import Signals
from tiago_mj.gap.simulation.session import Session
from tiago_mj.recordings.recording import Finding


@dataclass(frozen=True)
class Compared:
    """Recordings beside what the nominal model predicts of them.

    Attributes:
        session: trials as they are compared.
        predict: what explanations predict.
        nominal: the nominal replay, or the measured motion, one row a trial.
        phase: what the robot was doing, (ntrials, T).
        proposed: what the search begins with.
        a_simulation: seconds of one.
        reserve: seconds that are needed once the search is over.
        notes: sentences on how it was compared.
        findings: of what was compared, beside those of the lint.
        hidden: effects that cannot show in it, whatever the motion.
        sharp: what was measured, with the tolerance that the recordings themselves show, by which explanations are
            sought; None: with that of ``proposed``, by which they are judged.
    """

    session: Session
    predict: Predictor
    nominal: Signals
    phase: NDArray[np.int_]
    proposed: Proposals
    a_simulation: float
    reserve: float
    notes: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    hidden: tuple[str, ...] = ()
    sharp: Data | None = None
