"""Return of a policy as the nominal and the repaired simulator predict it, beside the recorded return.

Both play one episode for each test trial under its conditions: the object and its pose, the goal, the joints' initial
positions, and the same seed of the sensor noise. Where the policy made the recordings, their return follows from the
measurements by the environment's own reward.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tiago_mj.effects import Entry
from tiago_mj.envs.flat import core_of
from tiago_mj.envs.hold_force import HoldForce
from tiago_mj.envs.state import State
from tiago_mj.gap.result import Diagnosis, Named
from tiago_mj.gap.simulation.plant import Plant, grasp_object
from tiago_mj.io.deadline import Deadline, OutOfTimeError
from tiago_mj.models import names
from tiago_mj.recordings.recording import RecordingError, Trial

Array = NDArray[np.float64]

#: Of the interval of a mean return over trials.
LEVEL: Final = 0.9
#: Arguments that a recorded environment had and that the diagnosis gives itself.
OURS: Final = ("effects", "render_mode", "goal", "width", "height")
SIMULATORS: Final = ("nominal", "repaired", "measured")


@dataclass(frozen=True)
class Asked:
    """A policy whose return is to be predicted, checked by :func:`ask`.

    Attributes:
        policy: its name or file, as :func:`tiago_mj.rollout.policies.make_policy` takes it.
        trust: whether a file may be loaded although loading runs code that it holds.
        plant: the nominal simulator, of an environment.
        trials: recordings of which some will be test trials.
        seed: of what is drawn where a recording has none of its own.
    """

    policy: str
    trust: bool
    plant: Plant
    trials: tuple[Trial, ...]
    seed: int


def ask(
    plant: Plant, trials: Sequence[Trial], policy: str | None, *, trust: bool = False, seed: int = 0
) -> Asked | None:
    """Check that a policy can be played under the conditions of recordings, before longer computations; None: no
    policy is asked for.

    Raises:
        RecordingError: the recordings are of no environment, or a sidecar lacks a goal or holds an impossible one.
        ValueError: the policy cannot be loaded or does not fit; says why.
    """
    if policy is None:
        return None
    if plant.environment is None:
        raise RecordingError(
            f"{trials[0].source}: --policy needs an environment to play in, and these recordings are of {plant.name}: "
            "leave --policy out, or give --env ID"
        )
    asked = Asked(policy, trust, plant, tuple(trials), seed)
    for trial in trials:
        goal_of(trial)
    if trials:
        env = make(plant, trials[0], ())
        try:
            _policy(asked, env)
            for trial in trials:
                set_conditions(core_of(env), plant, trial)
        finally:
            env.close()
    return asked


def told(
    diagnosis: Diagnosis,
    asked: Asked | None,
    deadline: Deadline | None = None,
    tick: Callable[[str, int], None] | None = None,
) -> Diagnosis:
    """The diagnosis with the policy's return; unchanged without a policy, and with a sentence where there was no
    time."""
    if asked is None:
        return diagnosis
    if not diagnosis.complete:
        note = f"The return of {Path(asked.policy).name} is not predicted, as the search did not come to its end."
        return replace(diagnosis, notes=(*diagnosis.notes, note))
    kept = set(diagnosis.splits.get("test", ()))
    tested = [trial for trial in asked.trials if trial.name in kept]
    if not tested:
        note = f"The return of {Path(asked.policy).name} is not predicted: it needs test trials, and there is none."
        return replace(diagnosis, notes=(*diagnosis.notes, note))
    if tick is not None:
        tick("playing the policy", len(tested))
    begun = time.monotonic()
    try:
        played = returns(asked, tested, diagnosis.repair, deadline)
    except OutOfTimeError:
        note = f"The time budget left no time to predict the return of {Path(asked.policy).name}."
        return replace(diagnosis, notes=(*diagnosis.notes, note))
    except KeyboardInterrupt:
        note = f"The return of {Path(asked.policy).name} is not predicted, as that was interrupted."
        return replace(diagnosis, notes=(*diagnosis.notes, note), interrupted=True)
    shrink = replace(diagnosis.shrink, task=played)
    return replace(diagnosis, shrink=shrink, seconds=diagnosis.seconds + time.monotonic() - begun)


def returns(
    asked: Asked, trials: Sequence[Trial], effects: Sequence[Named], deadline: Deadline | None = None
) -> dict[str, Any]:
    """Mean return of a policy over the recordings' conditions, nominal, repaired and measured.

    Args:
        asked: the policy.
        trials: kept for testing.
        effects: of the repaired simulator.
        deadline: asked before every step of a policy; None: there is none.

    Returns:
        ``policy``, and the means ``nominal``, ``repaired`` and ``measured``, the last None where not every one of the
        recordings was made by the policy or where they do not hold what the reward is of. With more than one trial,
        ``nominal_low``, ``nominal_high`` and so on are the ends of the 90 % interval of the mean (Student's t over
        trials). ``trials`` has the same three by name of the trial.

    Raises:
        OutOfTimeError: the deadline is over.
    """
    by = deadline or Deadline()
    nominal = _played(asked, trials, (), by)
    repaired = _played(asked, trials, effects, by) if effects else nominal
    measured = [measured_return(asked.plant, trial) if _made_by(asked, trial) else None for trial in trials]
    by_trial = {
        trial.name: dict(zip(SIMULATORS, values, strict=True))
        for trial, *values in zip(trials, nominal, repaired, measured, strict=True)
    }
    out: dict[str, Any] = {"policy": Path(asked.policy).name}
    ends: dict[str, float | None] = {}
    for name in SIMULATORS:
        values = [value for row in by_trial.values() if (value := row[name]) is not None]
        known = len(values) == len(trials)
        out[name] = float(np.mean(values)) if known else None
        if len(trials) > 1:
            spread = _spread(values) if known else None
            ends[f"{name}_low"] = None if spread is None else out[name] - spread
            ends[f"{name}_high"] = None if spread is None else out[name] + spread
    return {**out, **ends, "trials": by_trial}


def _spread(values: Sequence[float]) -> float:
    """Half-width of the mean's 90 % interval (Student's t)."""
    count = len(values)
    return float(stats.t.ppf(0.5 + LEVEL / 2, count - 1) * np.std(values, ddof=1) / np.sqrt(count))


# Playing -------------------------------------------------------------------------------------------------------------


def _played(asked: Asked, trials: Sequence[Trial], effects: Sequence[Named], deadline: Deadline) -> list[float]:
    """Simulated return for each trial; trials with equal arguments share an environment and a policy."""
    policies: dict[gymnasium.Env[Any, Any], Any] = {}
    found = []
    with environments(asked.plant, [effect.entry() for effect in effects]) as made_for:
        for number, trial in enumerate(trials):
            env = made_for(trial)
            if env not in policies:
                policies[env] = _policy(asked, env)
            seed = seed_of(trial, asked.seed + number)
            found.append(_episode(env, policies[env], trial, seed, _steps(asked, trial), deadline))
    return found


def _episode(
    env: gymnasium.Env[Any, Any], policy: Any, trial: Trial, seed: int, steps: int, deadline: Deadline
) -> float:
    observation, info = env.reset(seed=seed, options={"goal": goal_of(trial)})
    policy.reset()
    total = 0.0
    for _ in range(steps):
        deadline.check()
        observation, reward, terminated, truncated, info = env.step(policy(observation, info))
        total += float(reward)
        if terminated or truncated:
            break
    return total


@contextmanager
def environments(plant: Plant, effects: Sequence[Entry]) -> Iterator[Callable[[Trial], gymnasium.Env[Any, Any]]]:
    """While the block runs, a function that makes the environment of a trial, as :func:`make` does, and sets its next
    episode's conditions; trials with equal arguments share one."""
    made: dict[str, gymnasium.Env[Any, Any]] = {}

    def made_for(trial: Trial) -> gymnasium.Env[Any, Any]:
        key = json.dumps(_arguments(trial, plant), sort_keys=True, default=str)
        if key not in made:
            made[key] = make(plant, trial, effects)
        set_conditions(core_of(made[key]), plant, trial)
        return made[key]

    try:
        yield made_for
    finally:
        for env in made.values():
            env.close()


def make(plant: Plant, trial: Trial, effects: Sequence[Entry]) -> gymnasium.Env[Any, Any]:
    """The environment of a trial with effects and no time limit; the recordings set the length of episodes.

    Raises:
        RecordingError: it cannot be made; one line.
    """
    assert plant.environment is not None
    arguments = {**_arguments(trial, plant), **plant.environment}
    given = [*plant.given, *effects]
    try:
        return gymnasium.make(**arguments, effects=given or None, max_episode_steps=-1, disable_env_checker=True)
    except (TypeError, ValueError) as fault:
        raise RecordingError(f"{trial.source}: {plant.name} cannot be made as it was recorded: {fault}") from fault


def _arguments(trial: Trial, plant: Plant) -> dict[str, Any]:
    """Arguments that the recorded environment was made with (its reward, for example), if it is the same."""
    said = trial.sidecar.raw.get("arguments")
    if not isinstance(said, Mapping) or trial.sidecar.robot.removeprefix("tiago_mj/") != plant.name:
        return {}
    return {str(key): value for key, value in said.items() if key not in OURS}


def _policy(asked: Asked, env: gymnasium.Env[Any, Any]) -> Any:
    from tiago_mj.rollout.policies import make_policy

    return make_policy(asked.policy, env, seed=asked.seed, trust=asked.trust)


def set_conditions(core: Any, plant: Plant, trial: Trial) -> None:
    """Set the next episode's object, its pose, and the joints at rest at their set points, as in a trial.

    Raises:
        RecordingError: the trial's goal is not one of the environment's; one line.
    """
    start = plant.starts[trial.name]
    for joint, address in zip(core.joints, core.qpos_address, strict=True):
        if joint in plant.actuators:
            core.initial_qpos[address] = start.set_point[plant.actuators.index(joint)]
    if start.item is not None and core.object_choice is not None:
        said = trial.sidecar.object or {}
        offset = grasp_object(said)[1] if said else core.object_choice.offset.low
        place = said.get("position_m")
        core.begin_with(start.item, offset, None if place is None else np.array(place[:2], dtype=np.float64))
    try:
        core.checked_goal(goal_of(trial))
    except ValueError as fault:
        raise RecordingError(f"{trial.source}: goal in the sidecar: {fault}") from fault


def goal_of(trial: Trial) -> Any:
    """What was asked in a trial.

    Raises:
        RecordingError: its sidecar does not say; one line.
    """
    if trial.sidecar.goal is None:
        raise RecordingError(
            f'{trial.source}: a return needs the goal of every trial, and its sidecar has none: write "goal": [...]'
        )
    return trial.sidecar.goal


def seed_of(trial: Trial, otherwise: int) -> int:
    """Seed of the recording where it has one, so that without effects the episode is the recorded one."""
    source = trial.sidecar.source
    seed = source.get("seed") if isinstance(source, Mapping) else None
    return seed if isinstance(seed, int) and seed >= 0 else otherwise


def _steps(asked: Asked, trial: Trial) -> int:
    """Control steps of the episode: as recorded with this policy, else as the environment has."""
    if _made_by(asked, trial):
        return len(_steps_end(trial))
    return limit(asked.plant) or len(_steps_end(trial))


def limit(plant: Plant) -> int | None:
    """Control steps of an episode, as the environment is registered."""
    assert plant.environment is not None
    return gymnasium.spec(str(plant.environment["id"])).max_episode_steps


# Measured ------------------------------------------------------------------------------------------------------------


def _made_by(asked: Asked, trial: Trial) -> bool:
    motion = trial.sidecar.motion
    return isinstance(motion, Mapping) and motion.get("policy") == Path(asked.policy).stem


def _steps_end(trial: Trial) -> NDArray[np.intp]:
    """Row at the end of every control step: that of the next command, or the last row."""
    sent = np.zeros(len(trial.time), dtype=bool)
    for values in trial.commands.values():
        sent |= np.isfinite(values)
    last = len(trial.time) - 1
    return np.append(np.flatnonzero(sent)[1:], [] if sent[last] else [last]).astype(np.intp)


def measured_return(plant: Plant, trial: Trial) -> float | None:
    """Return of a recorded episode, by the environment's own reward; None where that needs what was not measured."""
    env = make(plant, trial, ())
    try:
        core = core_of(env)
        achieved = _achieved(core, trial)[_steps_end(trial)]
        goal = np.asarray(goal_of(trial), dtype=np.float64)
        if not np.isfinite(achieved).all() or not len(achieved):
            return None
        return float(np.sum(core.compute_reward(achieved, np.broadcast_to(goal, achieved.shape), {})))
    finally:
        env.close()


def _achieved(core: Any, trial: Trial) -> Array:
    """Achieved goal from measurements, (T, g); NaN where not measured."""
    rows = len(trial.time)
    position = _columns(trial.positions, core.joints, rows)
    force = _columns(trial.forces, names.SIDES, rows)
    if isinstance(core, HoldForce) and core.observation_space["achieved_goal"].shape == force.shape[1:]:
        return force  # also where the agent does not see it
    state = State(
        position=position,
        velocity=_columns(trial.velocities, core.joints, rows),
        force_contact=np.full((rows, 2), np.nan),
        force_raw=force,
        force_binary=np.full((rows, 2), np.nan),
        grasp_position=_grasp_points(core, position),
        object_pose=np.full((rows, 7), np.nan),
        object_velocity=np.full((rows, 6), np.nan),
    )
    goal = np.broadcast_to(core.goal, (rows, len(core.goal)))
    return np.asarray(core.observed(state, goal)["achieved_goal"])


def _grasp_points(core: Any, position: Array) -> Array:
    """Point between the fingers from measured joint positions by forward kinematics, (T, 3) [m]."""
    import mujoco

    out = np.full((len(position), 3), np.nan)
    data = mujoco.MjData(core.model)
    for k in np.flatnonzero(np.isfinite(position).all(axis=1)):
        data.qpos[:] = core.initial_qpos
        data.qpos[core.qpos_address] = position[k]
        mujoco.mj_kinematics(core.model, data)
        out[k] = data.site(names.GRASP_SITE).xpos
    return out


def _columns(channels: Mapping[str, Array], wanted: Sequence[str], rows: int) -> Array:
    """Channels as columns, (T, n); gaps are filled with the last value before."""
    out = np.full((rows, len(wanted)), np.nan)
    for column, name in enumerate(wanted):
        values = np.asarray(channels.get(name, out[:, column]))
        last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(rows), 0))
        out[:, column] = values[last]
    return out
