"""What a gap costs on the task: the return of a policy, predicted by the nominal and by the repaired simulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from tiago_mj.gap.effects.spec import Entry
from tiago_mj.gap.plant import Plant, grasp_object
from tiago_mj.gap.recording import RecordingError, Trial
from tiago_mj.models import names


def task_return(
    plant: Plant, trials: Sequence[Trial], effects: Sequence[Entry], policy: str, *, trust: bool = False, seed: int = 0
) -> dict[str, Any]:
    """Mean return of a policy over the conditions of recordings: their objects, offsets and goals.

    Args:
        plant: the nominal simulator, of an environment.
        trials: those kept for testing; the episodes repeat their conditions.
        effects: of the repaired simulator.
        policy: ``pi`` or the path of a stable-baselines3 policy.
        trust: load a policy file although loading runs what it holds.
        seed: of the sensors' noise; the same for both simulators.

    Returns:
        ``policy``, ``nominal``, ``repaired`` and ``measured``: the last is computed from the readings of those
        recordings that this policy made, None where there are none.

    Raises:
        RecordingError: the recordings are not of an environment, or there is none to test on.
        ValueError: the policy cannot be loaded; says why.
    """
    if plant.environment is None:
        raise RecordingError(
            f"{trials[0].source if trials else plant.name}: --policy needs recordings of an environment"
        )
    if not trials:
        raise RecordingError("--policy compares returns on test trials, and there is none: record more than one")
    given = [
        {"name": e.name, "target": list(e.target or ()) or "all", "parameters": dict(e.parameters)} for e in effects
    ]
    nominal, repaired, measured = [], [], []
    for k, trial in enumerate(trials):
        with _Conditions(plant.environment, trial) as env:
            nominal.append(_play(env, policy, trust, seed + k))
            if trial.sidecar.motion and trial.sidecar.motion.get("policy") == Path(policy).stem:
                measured.append(_measured(env, trial))
        with _Conditions(plant.environment, trial, effects=given or None) as env:
            repaired.append(_play(env, policy, trust, seed + k))
    known = [value for value in measured if value is not None]
    return {
        "policy": Path(policy).name,
        "nominal": float(np.mean(nominal)),
        "repaired": float(np.mean(repaired)),
        "measured": float(np.mean(known)) if known else None,
    }


class _Conditions:
    """An environment in a trial's conditions, closed at the end."""

    def __init__(self, given: Mapping[str, Any], trial: Trial, **more: Any) -> None:
        arguments = {key: value for key, value in given.items() if key != "id"}
        conditions: dict[str, Any] = {}
        item, offset = grasp_object(trial.sidecar.object)
        if item is not None:
            conditions = {"object": item, "object_offset": offset}
        if isinstance(trial.sidecar.goal, Sequence) and len(set(trial.sidecar.goal)) == 1:
            conditions["goal"] = float(trial.sidecar.goal[0])
        try:
            self.env = gymnasium.make(given["id"], **arguments, **conditions, **more)
        except TypeError:  # an environment whose object or goal is its own affair
            self.env = gymnasium.make(given["id"], **arguments, **more)

    def __enter__(self) -> gymnasium.Env[Any, Any]:
        return self.env

    def __exit__(self, *_: object) -> None:
        self.env.close()


def _play(env: gymnasium.Env[Any, Any], policy: str, trust: bool, seed: int) -> float:
    from tiago_mj.rollout.episode import play
    from tiago_mj.rollout.policies import make_policy

    return float(play(env, make_policy(policy, env, seed=seed, trust=trust), seed=seed).reward.sum())


def _measured(env: gymnasium.Env[Any, Any], trial: Trial) -> float | None:
    """Return of a recorded episode, from its readings; None where the reward is not of readings."""
    core: Any = getattr(env.unwrapped, "core", env.unwrapped)
    if trial.sidecar.goal is None or not all(side in trial.forces for side in names.SIDES):
        return None
    achieved = np.stack([trial.forces[side] for side in names.SIDES], axis=-1)[1:]
    goal = np.broadcast_to(np.asarray(trial.sidecar.goal, dtype=np.float64), achieved.shape)
    return float(np.nansum(core.compute_reward(achieved, goal, {})))
