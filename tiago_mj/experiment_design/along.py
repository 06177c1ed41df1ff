"""Which effects a motion with efforts excites, joint by joint, and which of them it cannot tell apart.

Without commands (or where efforts are commanded) torques are compared along the measured motion, by inverse dynamics.
Signatures are those of :mod:`tiago_mj.experiment_design.excitation`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tiago_mj.effects import EFFECTS
from tiago_mj.experiment_design.excitation import Excited, Preflight, signatures
from tiago_mj.gap.inference import hypotheses
from tiago_mj.gap.simulation import sizes
from tiago_mj.gap.simulation.along_a_motion import efforts_along
from tiago_mj.gap.simulation.session import Session
from tiago_mj.gap.torque.band import most_informative
from tiago_mj.gap.torque.channels import Wanted
from tiago_mj.gap.torque.shown import check_given, may_show, shown
from tiago_mj.recordings.recording import Finding


def preflight_along(session: Session, findings: Sequence[Finding]) -> Preflight:
    """Look at what the motion and the efforts of recordings would show of every effect, on every joint.

    Args:
        session: recordings with positions and efforts, and the nominal simulator with what is known already.
        findings: of the lint: channels that it discredits are left out.

    Raises:
        RecordingError: nothing moves, no effort can be used, or it is too short; one line.
    """
    trials, joints = efforts_along(session.plant, session.trials)
    check_given(trials, session.plant.given)
    measured = most_informative(session, trials, Wanted(joints, findings, session.plant.given))
    everything = range(len(measured.session.trials))
    plant, predict = measured.session.plant, measured.predict
    pool = hypotheses.candidates(plant, None, None, sizes.sizes(plant, measured.session.trials, measured.motion))
    alone = [c for c in shown(pool, predict.torques) if c.target is not None or _on_nothing_else(c, pool)]
    found, alike = signatures(predict, alone, everything, np.ones(len(predict.data.channels)), firm=True)
    seen = {one.effect for one in found}
    dull = [Excited(name, _strength(name), "", None, 0.0) for name in EFFECTS if name not in seen and may_show(name)]
    return Preflight(
        plant.name,
        len(trials),
        (*found, *dull),
        alike,
        notes=(
            "Efforts are compared along the measured motion, as nothing else was commanded: effects on commands, "
            "servos, timing and load cells are not looked at.",
            *measured.usable.notes,
        ),
    )


def _on_nothing_else(candidate: hypotheses.Candidate, pool: Sequence[hypotheses.Candidate]) -> bool:
    """Whether an effect is sought on all its targets only."""
    return not any(other.effect == candidate.effect and other.target is not None for other in pool)


def _strength(effect: str) -> str:
    """Name of the parameter that is an effect's size."""
    return next(p.name for p in EFFECTS[effect].parameters.values() if p.identity is not None)
