"""Whether recordings are explained along their motion, and which efforts of which joints then are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.recordings.recording import Array, RecordingError, Trial


def torques_along_a_motion(plant: Plant, trials: Sequence[Trial]) -> bool:
    """Whether what is commanded is the efforts of joints whose motion was measured.

    Nothing pulls such a joint back to where it was, so that a replay of its commands adds up every error of torque;
    along the measured motion torques are compared with torques.
    """
    driven = _driven(plant)
    return all(
        trial.sidecar.interface == "effort"
        and bool(trial.commands)
        and {driven.get(name, name) for name in trial.commands} <= set(trial.positions)
        for trial in trials
    )


def along_a_motion(plant: Plant, trials: Sequence[Trial]) -> bool:
    """Whether recordings are explained along their motion: nothing was commanded, or efforts were."""
    return not any(trial.commands for trial in trials) or torques_along_a_motion(plant, trials)


def efforts_along(plant: Plant, trials: Sequence[Trial]) -> tuple[tuple[Trial, ...], tuple[str, ...]]:
    """Recordings whose commanded efforts count as efforts of the joints that they drive, and the joints of the model
    that have some.

    Raises:
        RecordingError: no joint of the model has an effort; one line.
    """
    if torques_along_a_motion(plant, trials):
        trials = [replace(trial, efforts={**_commanded(plant, trial), **trial.efforts}) for trial in trials]
    known = {plant.model.joint(j).name for j in range(plant.model.njnt)}
    joints = tuple(name for name in dict.fromkeys(n for trial in trials for n in trial.efforts) if name in known)
    if not joints:
        raise RecordingError(
            f"{trials[0].source}: no command and no effort of a joint of this robot: nothing can be replayed; add "
            "command.<actuator>, or effort.<joint>"
        )
    return tuple(trials), joints


def _driven(plant: Plant) -> dict[str, str]:
    """The joint of every actuator that is commanded."""
    return {name: plant.joints[k] for name, k in zip(plant.actuators, plant.wiring.targets.actuated, strict=True)}


def _commanded(plant: Plant, trial: Trial) -> dict[str, Array]:
    """Commanded efforts by joint, (T,) [N, N·m]: an actuator may have another name than its joint, a gear, a gain."""
    model, driven = plant.model, _driven(plant)
    per_unit = model.actuator_gainprm[:, 0] * model.actuator_gear[:, 0]
    return {
        driven[name]: float(per_unit[actuator]) * trial.commands[name]
        for name, actuator in zip(plant.actuators, plant.wiring.actuators, strict=True)
        if name in trial.commands
    }
