"""Sets of effects that explain what position servos gave along the measured motion.

Commands that are replayed lead to motions that no large effect changes in proportion: beside friction a load moves the
arm elsewhere. Along the *measured* motion a servo's torque follows from its law, the command and the position, and is
linear in most effects, so that whole sets of them are found by least squares (the equation error; Swevers et al. 1997).
Noise that is differentiated and a servo that is not as the model says make it inexact: it only proposes, and what it
proposes is fitted to the replay as everything else is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.inference import hypotheses
from tiago_mj.gap.inference.fit import Fitted
from tiago_mj.gap.search import beginning, together
from tiago_mj.gap.search.state import MIN_WEIGHT_WHILE_UNEXPLAINED, Question
from tiago_mj.gap.simulation import sizes
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.session import FITTED, Session
from tiago_mj.gap.simulation.subset import Subset
from tiago_mj.gap.torque.band import most_informative
from tiago_mj.gap.torque.channels import Wanted
from tiago_mj.gap.torque.shown import shown
from tiago_mj.io.deadline import Deadline
from tiago_mj.recordings.read.pd_torques import before_and_after, velocity
from tiago_mj.recordings.recording import Array, RecordingError, Trial

#: Of what acts on torques, wherever these come from; the others are about a log of efforts.
ON_TORQUES: Final = ("actuator", "transmission", "body")


def sets(session: Session, names: Sequence[str] | None, seed: int, deadline: Deadline) -> list[Fitted]:
    """Explanations of the servos' torques along the motion of the trials that are fitted; none where these do not
    follow from commands and positions.

    Args:
        session: recordings with commands.
        names: effects to consider; None for the whole library.
        seed: of the noise that is drawn.
        deadline: of all that is computed.

    Raises:
        OutOfTimeError: the deadline is over.
    """
    plant = session.plant
    trials = [with_efforts(plant, session.trials[k]) for k in session.subset(*FITTED)]
    known = [trial for trial in trials if trial is not None]
    if len(known) < len(trials) or plant.environment is not None or plant.cell is not None:
        return []
    joints = tuple(plant.joints[j] for j in plant.wiring.targets.actuated)
    try:
        found = most_informative(session, known, Wanted(joints, (), plant.given, seed, deadline))
    except RecordingError:
        return []  # nothing moves, or for too short a time
    along, predict, everything = found.session.plant, found.predict, Subset(tuple(range(len(found.session.trials))))
    pool = hypotheses.candidates(along, names, None, sizes.sizes(along, found.session.trials, found.motion))
    pool = tuple(c for c in shown(pool, predict.torques) if EFFECTS[c.effect].stage in ON_TORQUES)
    base = predict.all_trials([()], everything)[0]
    asked = Question(predict, predict.data, everything, pool, hypotheses.terms(along), base)
    full, _ = beginning.fitter(asked, deadline.over)
    state = replace(beginning.with_nominal(full, asked.first_trials), pool=pool)
    return together.explained(state.with_weight(np.maximum(state.full.weight, MIN_WEIGHT_WHILE_UNEXPLAINED)))


def with_efforts(plant: Plant, trial: Trial) -> Trial | None:
    """A trial with the torques that its servos gave by the model's law [N, N·m]; None where that does not say them: of
    other drives than plain position servos, or without the command or position of one.

    A command is held until the next row, so that a torque is that of a path half a row late: taken with the command of
    its own row alone it would be larger by the servo's stiffness times half a row, as viscous friction is. It is the
    mean of those just before and just after the command changes. NaN where none was given yet, or no position read.
    """
    model, wiring = plant.model, plant.wiring
    if wiring.interface != "position" or not (wiring.servo & (wiring.act < 0)).all():
        return None
    efforts: dict[str, Array] = {}
    for k, (name, actuator) in enumerate(zip(plant.actuators, wiring.actuators, strict=True)):
        joint = plant.joints[wiring.targets.actuated[k]]
        if name not in trial.commands or joint not in trial.positions or len(trial.time) < 2:
            return None
        position, gear = trial.positions[joint], float(model.actuator_gear[actuator, 0])
        gain, (constant, stiffness, damping) = model.actuator_gainprm[actuator, 0], model.actuator_biasprm[actuator, :3]
        command = before_and_after(trial.commands[name])
        force = gain * command + constant + gear * (stiffness * position + damping * velocity(trial, joint))
        if model.actuator_forcelimited[actuator]:
            force = np.clip(force, *model.actuator_forcerange[actuator])
        efforts[joint] = gear * force.mean(axis=0)
        if not np.isfinite(efforts[joint]).any():
            return None
    return replace(trial, efforts=efforts)
