"""Policies by name or file, for the command line."""

from __future__ import annotations

import importlib
import inspect
import os
import re
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np

from tiago_mj.control.force_pi import ForcePI
from tiago_mj.control.scripted import Scripted
from tiago_mj.control.tuned import tuned_pi
from tiago_mj.envs.flat import core_of
from tiago_mj.envs.hold_force import HoldForce
from tiago_mj.io import arrays, extra
from tiago_mj.io.loading import MAX_BYTES, parse_json
from tiago_mj.io.quoting import quoted
from tiago_mj.learn.agent_file import SUFFIX, Agent, load_agent
from tiago_mj.learn.shipped import shipped_agents
from tiago_mj.rollout.episode import Policy

#: Algorithms of stable-baselines3 by a setting that only they store; DDPG is stored as the TD3 that it is made of.
ALGORITHMS: Final = {"clip_range": "PPO", "target_entropy": "SAC", "policy_delay": "TD3", "gae_lambda": "A2C"}
#: The policy whose actions are drawn.
RANDOM: Final = "random"
#: Policies that are no agents and no files.
NAMED: Final = ("pi", "pi-tuned", "scripted", RANDOM)
#: A function of a module.
_FUNCTION: Final = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
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
        """A random action, independent of the observation."""
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


class FunctionPolicy:
    """Any callable that acts on an observation; what it remembers, it forgets in a ``reset`` of its own."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self._function = function

    def reset(self) -> None:
        """Call the callable's own ``reset``, where it has one."""
        forget = getattr(self._function, "reset", None)
        if forget is not None:
            forget()

    def __call__(self, observation: Any, info: dict[str, Any]) -> Any:
        """The callable's action."""
        return self._function(observation)


def as_policy(given: Any) -> Policy:
    """Anything that acts, as a policy.

    Args:
        given: a :class:`Policy`; a model of stable-baselines3, which acts without exploration; or a callable that
            takes an observation and returns an action.

    Raises:
        ValueError: it is none of them; one line.
    """
    if hasattr(given, "predict"):
        return LearnedPolicy(given)
    if not callable(given):
        raise ValueError(
            f"policy is {type(given).__name__}: give a callable that takes an observation and returns an action, or a "
            "model of stable-baselines3"
        )
    if hasattr(given, "reset") and _takes_info(given):
        policy: Policy = given
        return policy
    return FunctionPolicy(given)


def _takes_info(function: Callable[..., Any]) -> bool:
    try:
        inspect.signature(function).bind(None, None)
    except (TypeError, ValueError):  # it takes another number, or is written in C and says nothing
        return False
    return True


def make_policy(name: str, env: gymnasium.Env[Any, Any], *, seed: int, trust: bool) -> Policy:
    """A policy for an environment.

    Args:
        name: ``pi``, ``pi-tuned``, ``scripted`` (of the reach, push and pick-and-place tasks), ``random``, the name of
            an agent that comes with the package, or a path: of an agent's npz, which only holds numbers, or of a zip
            file saved by stable-baselines3; or ``module:function``, a callable that takes an observation and returns an
            action, of a module that Python finds here or where it finds all others.
        env: what it will command.
        seed: of the random policy.
        trust: whether files may be unpickled, and modules imported.

    Raises:
        ValueError: there is no such policy or file, it is not trusted, or it does not fit the environment.
        ModuleNotFoundError: the file needs stable-baselines3, which is not installed.
    """
    if name in ("pi", "pi-tuned"):
        core = core_of(env)
        if not isinstance(core, HoldForce) or core.force_type == "none":
            raise ValueError(
                f"policy {name} holds a force that load cells feel: use an environment with such a goal, "
                "GripperTactile-v0 or TIAGoTactile-v0"
            )
        return ForcePI.for_env(env) if name == "pi" else tuned_pi(env)
    if name == "scripted":
        return Scripted.for_env(env)
    if name == RANDOM:
        assert isinstance(env.action_space, gymnasium.spaces.Box)
        return RandomPolicy(env.action_space, seed)
    if (agent := find_agent(name)) is not None:
        agent.check_fits(env, name)
        return agent
    if _FUNCTION.fullmatch(name) and not Path(name).exists():
        return as_policy(_imported(name, trust))
    return LearnedPolicy(_load(Path(name), env, trust))


def absolute(name: str) -> str:
    """A policy for processes of another working directory: a file by its whole path; a name means what it always does,
    whatever lies here."""
    named = name in NAMED or name in shipped_agents()
    return str(Path(name).resolve()) if not named and Path(name).exists() else name


def find_agent(name: str) -> Agent | None:
    """The agent file of a name or path; None where there is none of that name and it is no npz file.

    Raises:
        ValueError: the file is damaged, or no agent.
    """
    agents = shipped_agents()
    if name in agents:
        return load_agent(agents[name], name)
    path = Path(name)
    return load_agent(path) if path.suffix == SUFFIX and path.is_file() else None


def _imported(name: str, trust: bool) -> Any:
    """What ``module:function`` names."""
    module, _, attribute = name.partition(":")
    if not trust:
        raise ValueError(f"policy {name}: importing {module} runs its code; if you know who wrote it, add --trust")
    if "" not in sys.path and os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    try:
        return getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as fault:
        raise ValueError(f"policy {name}: {arrays.reason(fault)}: write it as MODULE:FUNCTION") from fault


def _load(path: Path, env: gymnasium.Env[Any, Any], trust: bool) -> Any:
    algorithm = _algorithm(path)
    if not trust:
        raise ValueError(
            f"policy {path}: a stable-baselines3 file holds pickled Python, which can run any program when it is "
            "loaded; if you know who made it, add --trust"
        )
    loader = getattr(extra.load("stable_baselines3", f"policy {path}", "train"), algorithm)
    try:
        model = loader.load(path, env=env, device="cpu", custom_objects=dict(_NO_BUFFER))
        if not all(bool(value.isfinite().all()) for value in model.policy.state_dict().values()):
            raise ValueError("it has weights that are not finite")
        return model
    except Exception as fault:
        reason = arrays.reason(fault)
        raise ValueError(f"policy {path}: {algorithm} could not load it for this environment: {reason}") from fault


def _algorithm(path: Path) -> str:
    """Algorithm of a stable-baselines3 file, read from its JSON settings; nothing is unpickled here."""
    if not path.is_file():
        named = ", ".join((*NAMED, *shipped_agents()))
        raise ValueError(
            f"policy {quoted(str(path))} is unknown: give {named}, an agent's {SUFFIX} file, a file saved by "
            "stable-baselines3, or MODULE:FUNCTION"
        )
    try:
        with zipfile.ZipFile(path) as archive, archive.open("data") as data:
            settings = parse_json(data.read(MAX_BYTES + 1), "its settings are no JSON")
    except (OSError, *arrays.FAULTS) as fault:
        raise ValueError(f"policy {path} is not a file saved by stable-baselines3: {arrays.reason(fault)}") from fault
    for key, algorithm in ALGORITHMS.items():
        if isinstance(settings, dict) and key in settings:
            return algorithm
    raise ValueError(f"policy {path} is of an unknown algorithm: {', '.join(ALGORITHMS.values())} and DDPG are known")
