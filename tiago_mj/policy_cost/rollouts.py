"""Logged rollouts as episodes: the conditions of each, and either a policy in them or the logged actions themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from tiago_mj.effects import Entry
from tiago_mj.envs.flat import core_of
from tiago_mj.gap.analysis import task
from tiago_mj.gap.simulation.plant import Plant, plant_of
from tiago_mj.policy_cost.play import Outcome, finish
from tiago_mj.recordings import lint
from tiago_mj.recordings.motions.play import Motion
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.record.environment import MotionPlayer
from tiago_mj.recordings.recording import RecordingError, Trial
from tiago_mj.rollout.episode import Policy


@dataclass(frozen=True)
class Rollouts:
    """Recorded episodes of an environment.

    Attributes:
        plant: the environment, with the arguments that the recordings say.
        trials: one an episode.
    """

    plant: Plant
    trials: tuple[Trial, ...]

    @property
    def measured(self) -> list[float | None]:
        """The return of each as it was measured; None where the reward is of something that was not."""
        return [task.measured_return(self.plant, trial) for trial in self.trials]


def read(paths: Sequence[Path], env: str | None) -> Rollouts:
    """Rollouts from files and folders of recordings.

    Args:
        paths: as :func:`tiago_mj.recordings.read.read_recordings` takes them.
        env: id of the environment, where the recordings do not say.

    Raises:
        RecordingError: they cannot be used, are of no environment, or say no goal; one line.
    """
    found = read_recordings(paths, defaults={"robot": env} if env else {}, robot=env)
    plant = plant_of(found.trials, env=env)
    lint.refuse(found.trials, (*found.findings, *lint.inspect_all(found.trials, plant)))
    if plant.environment is None:
        raise RecordingError(
            f"{found.trials[0].source}: a return needs the reward of an environment, and these recordings are of "
            f"{plant.name}: use tiago_mj.policy_cost.cost in Python, with an environment of your own"
        )
    for trial in found.trials:
        task.goal_of(trial)
    return Rollouts(plant, found.trials)


def simulate(rollouts: Rollouts, effects: Sequence[Entry], policy: Policy | None, *, seed: int = 0) -> list[Outcome]:
    """One episode a rollout, under its conditions: object and place, goal, where the joints stand, seed of the noise.

    Args:
        rollouts: of :func:`read`.
        effects: that the simulator has beside the nominal model.
        policy: that acts, to the episode's usual end; None: the logged actions are sent again (open loop), as many as
            were logged.
        seed: of rollouts that have none of their own; each later one adds 1.

    Raises:
        RecordingError: a command is beyond what the environment takes, or another fault of a recording; one line.
    """
    outcomes = []
    with task.environments(rollouts.plant, effects) as made_for:
        for number, trial in enumerate(rollouts.trials):
            env = made_for(trial)
            player, steps = (policy, task.limit(rollouts.plant)) if policy is not None else actions_of(env, trial)
            chosen = task.seed_of(trial, seed + number)
            observation, info = env.reset(seed=chosen, options={"goal": task.goal_of(trial)})
            player.reset()
            outcomes.append(finish(env, player, observation, info, steps))
    return outcomes


def actions_of(env: gymnasium.Env[Any, Any], trial: Trial) -> tuple[Policy, int]:
    """What sends the logged actions again, and how many they are.

    Raises:
        RecordingError: nothing was commanded, or what the environment does not take; one line.
    """
    core = core_of(env)
    if trial.sidecar.raw.get("command_reference") is not None:
        raise RecordingError(
            f"{trial.source}: its commands are changes from the measured position, which cannot be sent again without "
            "a policy: give --policy"
        )
    sent = {name: values for name, values in trial.commands.items() if name in core.joints}
    rows = np.flatnonzero(np.any([np.isfinite(values) for values in sent.values()], axis=0)) if sent else np.array([])
    if not len(rows):
        raise RecordingError(
            f"{trial.source}: no commands of this environment's joints: log the actions, or give --policy"
        )
    first, last = int(rows[0]), int(rows[-1]) + 1
    time = trial.time[first:last] - trial.time[first]
    commands = {name: _held(values[first:last]) for name, values in sent.items()}
    motion = Motion(trial.name, time, commands, trial.sidecar.interface)
    try:
        return MotionPlayer(core, motion), motion.steps(1 / core.dt)
    except ValueError as fault:
        raise RecordingError(f"{trial.source}: {fault}") from fault


def _held(values: Any) -> Any:
    """Commands, each held until the next; before the first, that."""
    known = np.flatnonzero(np.isfinite(values))
    row = np.maximum(np.searchsorted(known, np.arange(len(values)), side="right") - 1, 0)
    return np.asarray(values)[known[row]]


def nominal_env(rollouts: Rollouts) -> gymnasium.Env[Any, Any]:
    """The environment of the first rollout, for a policy to be made for."""
    return task.make(rollouts.plant, rollouts.trials[0], ())
