"""The band of frequencies that is compared: of several low-pass cut-offs the one that tells most.

A high cut-off keeps sharp reversals, and with them resonances, play and rounded positions that no model of rigid joints
has; differentiated twice they drown what inertia and friction do. A low one leaves few independent samples. What counts
is how far the gap stands out of what remains of it when everything is in the model, over the independent samples.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import mujoco
import numpy as np

from tiago_mj.effects import Entry
from tiago_mj.gap.torque.channels import Usable, choose
from tiago_mj.gap.torque.evidence import Evidence
from tiago_mj.gap.torque.strips import HEADROOMS
from tiago_mj.io.deadline import Deadline, OutOfTimeError
from tiago_mj.recordings.recording import Finding, RecordingError, Trial


def clearest(
    trials: Sequence[Trial],
    model: mujoco.MjModel,
    joints: Sequence[str],
    findings: Sequence[Finding],
    seed: int,
    known: Mapping[tuple[str, str | None], float],
    names: Collection[str] | None = None,
    given: Sequence[Entry] = (),
    tick: Callable[[str], None] = lambda stage: None,
    deadline: Deadline | None = None,
) -> tuple[Usable, Evidence]:
    """Channels and evidence, the cut-off lowered from the highest for as long as the gap stands out more.

    Args:
        trials, model, joints, findings, seed: as for :func:`tiago_mj.gap.torque.diagnose_inverse`.
        known: what the recordings say of the model's numbers.
        names: effects to consider; None for all.
        given: effects that are known already.
        tick: told what begins.
        deadline: of all that is computed; where it is over at a lower cut-off, the one before stays. None: there is
            none.

    Raises:
        OutOfTimeError: the deadline is over at the highest cut-off.
        RecordingError: as :func:`tiago_mj.gap.torque.channels.choose` does at the highest cut-off.
        ValueError: the model lacks a joint.
    """
    tick("comparing torques")
    found = _at(HEADROOMS[0], trials, model, joints, findings, seed, known, names, given, deadline)
    for headroom in HEADROOMS[1:]:
        tick("narrowing the band")
        try:
            lower = _at(headroom, trials, model, joints, findings, seed, known, names, given, deadline)
        except (RecordingError, OutOfTimeError):
            break  # too short a recording for so long a filter, or no time for it
        same = lower[1].course.channels == found[1].course.channels
        if not same or len(lower[1].blocks.names) < 2 or clearness(lower[1]) <= clearness(found[1]):
            break
        found = lower
    return found


def clearness(evidence: Evidence) -> float:
    """Squared gap over squared residual of the most flexible model, times independent samples, over all channels."""
    gap = evidence.measured - evidence.nominal
    used = evidence.moving & evidence.fitted_rows[:, None]
    squares = np.array([np.mean(gap[used[:, c], c] ** 2) if used[:, c].any() else 0.0 for c in range(gap.shape[1])])
    return float((squares / evidence.floor.spread**2 * evidence.effective).sum())


def _at(
    headroom: float,
    trials: Sequence[Trial],
    model: mujoco.MjModel,
    joints: Sequence[str],
    findings: Sequence[Finding],
    seed: int,
    known: Mapping[tuple[str, str | None], float],
    names: Collection[str] | None = None,
    given: Sequence[Entry] = (),
    deadline: Deadline | None = None,
) -> tuple[Usable, Evidence]:
    usable = choose(trials, model, joints, findings, headroom, given, deadline)
    return usable, Evidence(usable.course, usable.torques, seed, known, names)
