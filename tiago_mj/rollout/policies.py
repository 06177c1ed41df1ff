"""Policies by name or file, for the command line."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np

from tiago_mj.control.force_pi import ForcePI
from tiago_mj.envs.hold_force import HoldForce
from tiago_mj.rollout.episode import Policy

#: Algorithms of stable-baselines3 by a setting that only they store; DDPG is stored as the TD3 that it is made of.
ALGORITHMS: Final = {"clip_range": "PPO", "target_entropy": "SAC", "policy_delay": "TD3", "gae_lambda": "A2C"}
#: The policy whose actions are drawn.
RANDOM: Final = "random"
#: Replay buffers are not needed to run a policy, and can take gigabytes.
_NO_BUFFER: Final[dict[str, Any]] = {"buffer_size": 1, "replay_buffer_class": None, "replay_buffer_kwargs": {}}


class RandomPolicy:
    """Uniform actions."""

    def __init__(self, space: gymnasium.spaces.Box, seed: int) -> None:
        self._space = space
        self._rng = np.random.default_rng(seed)

    def reset(self) -> None:
        """Nothing is remembered but the generator's state."""

    def __call__(self, observation: Any, info: dict[str, Any]) -> Any:
        """A new action, whatever was seen."""
        return self._rng.uniform(self._space.low, self._space.high).astype(np.float32)


class LearnedPolicy:
    """A stable-baselines3 model, acting without exploration."""

    def __init__(self, model: Any) -> None:
        self._model = model

    def reset(self) -> None:
        """These policies have no memory."""

    def __call__(self, observation: Any, info: dict[str, Any]) -> Any:
        """The model's deterministic action."""
        return self._model.predict(observation, deterministic=True)[0]


def make_policy(name: str, env: gymnasium.Env[Any, Any], *, seed: int, trust: bool) -> Policy:
    """A policy for an environment.

    Args:
        name: ``pi``, ``random``, or the path of a zip file saved by stable-baselines3.
        env: what it will command.
        seed: of the random policy.
        trust: whether files may be unpickled.

    Raises:
        ValueError: there is no such policy or file, it is not trusted, or it does not fit the environment.
        ModuleNotFoundError: the file needs stable-baselines3, which is not installed.
    """
    if name == "pi":
        core: Any = getattr(env.unwrapped, "core", env.unwrapped)  # a flat view's goal environment
        if not isinstance(core, HoldForce) or core.force_type == "none":
            raise ValueError(
                "policy pi holds a force that load cells feel: use an environment with such a goal, "
                "GripperTactile-v0 or TIAGoTactile-v0"
            )
        return ForcePI.for_env(env)
    if name == RANDOM:
        assert isinstance(env.action_space, gymnasium.spaces.Box)
        return RandomPolicy(env.action_space, seed)
    return LearnedPolicy(_load(Path(name), env, trust))


def _load(path: Path, env: gymnasium.Env[Any, Any], trust: bool) -> Any:
    algorithm = _algorithm(path)
    if not trust:
        raise ValueError(
            f"policy {path}: a stable-baselines3 file holds pickled Python, which can run any program when it is "
            "loaded; if you know who made it, add --trust"
        )
    try:
        import stable_baselines3
    except ModuleNotFoundError as fault:
        raise ModuleNotFoundError(
            f"policy {path}: {fault.name} is not installed; install it with: pip install 'tiago-mj[train]'"
        ) from fault
    loader = getattr(stable_baselines3, algorithm)
    try:
        return loader.load(path, env=env, device="cpu", custom_objects=dict(_NO_BUFFER))
    except Exception as fault:
        reason = " ".join(str(fault).split())
        raise ValueError(f"policy {path}: {algorithm} could not load it for this environment: {reason}") from fault


def _algorithm(path: Path) -> str:
    """Which algorithm made the file: read from its settings, which are JSON; nothing is unpickled here."""
    if not path.is_file():
        raise ValueError(f"policy {str(path)!r} is unknown: give pi, random, or a file saved by stable-baselines3")
    try:
        with zipfile.ZipFile(path) as archive:
            settings = json.loads(archive.read("data"))
    except (zipfile.BadZipFile, KeyError, ValueError) as fault:
        raise ValueError(f"policy {path} is not a file saved by stable-baselines3: {fault}") from fault
    for key, algorithm in ALGORITHMS.items():
        if key in settings:
            return algorithm
    raise ValueError(f"policy {path} is of an unknown algorithm: {', '.join(ALGORITHMS.values())} and DDPG are known")
