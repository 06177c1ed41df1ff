"""Hyperparameters in rl-zoo3's YAML form: one entry an environment, read and checked before anything starts.

An entry has rl-zoo3's own keys (:data:`OWN_KEYS`; ``hold``, ``hold_share``, ``leak``, ``action_cost``,
``value_range``, ``demonstrations`` and ``expert`` are ours) and arguments of the algorithm's class. What rl-zoo3 would
run as Python, such as ``policy_kwargs: "dict(net_arch=[400, 300])"``, is read as the literal that it is; nothing is
evaluated.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Mapping
from copy import copy
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import BeforeValidator, Field

from tiago_mj.io import extra
from tiago_mj.io.loading import load_yaml
from tiago_mj.io.quoting import is_number, is_one_of, quoted
from tiago_mj.io.schema import Closed, SchemaError
from tiago_mj.io.schema import checked as schema_checked
from tiago_mj.registration import NAMESPACE

#: Algorithm: class of stable-baselines3. The hyperparameters shipped for it are ``hyperparameters/NAME.yml``.
ALGORITHMS: Final[Mapping[str, str]] = {
    "td3": "TD3",
    "ddpg": "DDPG",
    "sac": "SAC",
    "ppo": "PPO",
    "a2c": "A2C",
    "her-td3": "TD3",
    "dagger": "TD3",
}
#: Of :class:`tiago_mj.learn.updates.FastTD3`, beyond rl-zoo3's.
FAST_KEYS: Final = ("hold", "hold_share", "leak", "action_cost", "value_range")
#: Keys of an entry that are not the class's arguments.
OWN_KEYS: Final = (
    "n_timesteps", "n_envs", "policy", "env_kwargs", "normalize", "noise_type", "noise_std", "demonstrations",
    "expert", *FAST_KEYS,
)  # fmt: skip
#: rl-zoo3's keys that name Python to be run, or change what the policy is given in ways that agents cannot record.
REFUSED: Final = ("env_wrapper", "vec_env_wrapper", "callback", "frame_stack", "monitor_kwargs")
#: Arguments of the classes that the command sets itself, or that agents and checkpoints do not know of.
_NOT_GIVEN: Final = frozenset(
    (
        "self", "policy", "env", "seed", "device", "verbose", "tensorboard_log", "action_noise", "replay_buffer_class",
        "optimize_memory_usage", "use_sde", "sde_sample_freq", "use_sde_at_warmup", "stats_window_size",
        "rollout_buffer_class", "rollout_buffer_kwargs", "_init_setup_model",
    )
)  # fmt: skip
#: What says nothing where there are no critics.
_OF_CRITICS: Final = frozenset(
    ("tau", "gamma", "n_steps", "policy_delay", "target_policy_noise", "target_noise_clip", "replay_buffer_kwargs")
)
NOISES: Final = ("normal", "ornstein-uhlenbeck")
ACTIVATIONS: Final = ("ReLU", "Tanh", "ELU")
#: Characters of a mapping that is written as Python.
_LONGEST: Final = 1000
#: The entry for environments that have none of their own.
DEFAULT: Final = "default"


def _whole(value: Any) -> Any:
    """A whole number, also from text such as 4e5, which YAML 1.1 reads as text."""
    number = float(value) if isinstance(value, (str, float)) else value
    return int(number) if isinstance(number, float) and number.is_integer() else number


def _mapping(value: Any) -> Any:
    """Value of text such as ``dict(net_arch=[400, 300], activation_fn=nn.ReLU)``, parsed and not evaluated."""
    if not isinstance(value, str):
        return {} if value is None else value
    if len(value) > _LONGEST:
        raise ValueError
    try:
        return _value(ast.parse(value, mode="eval").body)
    except (SyntaxError, TypeError, RecursionError, MemoryError) as fault:
        raise ValueError from fault


def _number(value: Any) -> Any:
    """A number, truth value or nothing; of text: a number, ``lin_NUMBER``, or a word that starts with ``auto``."""
    if isinstance(value, str) and not value.startswith("auto"):
        number = float(value.removeprefix("lin_"))
        value = value if value.startswith("lin_") else number  # YAML 1.1 reads 1e-3 as text
    else:
        number = value
    if not (number is None or isinstance(number, (bool, str)) or is_number(number)):
        raise ValueError
    return value


def _deviation(value: Any) -> Any:
    number = _number(value)
    start = float(number.removeprefix("lin_")) if isinstance(number, str) else number
    if not (is_number(start) and start >= 0):
        raise ValueError
    return number


def _interval(value: Any) -> Any:
    if value is not None and not (
        isinstance(value, list) and len(value) == 2 and all(map(is_number, value)) and value[0] < value[1]
    ):
        raise ValueError
    return value


def _train_freq(value: Any) -> Any:
    pair = value if isinstance(value, list) else [value, "step"]
    if len(pair) != 2 or not is_one_of(pair[1], ("step", "episode")):
        raise ValueError
    count = _whole(pair[0])
    if not isinstance(count, int) or isinstance(count, bool) or count < 1:
        raise ValueError
    return [count, pair[1]]


_Whole = Annotated[int, Field(ge=1), BeforeValidator(_whole)]
_Mapping = Annotated[dict[str, Any], BeforeValidator(_mapping)]
_Share = Annotated[float, Field(ge=0, le=1)]
_Numbers = dict[str, Annotated[Any, BeforeValidator(_number)]]
_WHOLE: Final = "give a whole number, 1 or more"
_MAPPING: Final = "give a mapping, or dict(NAME=VALUE, ...)"
_Sizes = list[Annotated[int, Field(ge=1, le=100_000)]]


class _PolicyArguments(Closed):
    """Policy arguments that an exported agent supports."""

    net_arch: _Sizes | dict[str, _Sizes] = Field(default=[], description="give a list of layers' sizes")
    activation_fn: Annotated[
        Literal["ReLU", "Tanh", "ELU"],
        BeforeValidator(lambda value: value.removeprefix("nn.") if isinstance(value, str) else value),
    ] = Field(default="ReLU", description=f"use {', '.join(f'nn.{a}' for a in ACTIVATIONS)}")
    n_critics: int = Field(default=2, ge=1, le=100, description="give a whole number, 1 or more")
    log_std_init: float = Field(default=0.0, description="give a number")
    ortho_init: bool = Field(default=True, description="give true or false")


class _Normalise(Closed):
    norm_obs: bool = Field(default=True, description="give true or false")
    norm_reward: bool = Field(default=True, description="give true or false")
    clip_obs: float = Field(default=10.0, gt=0, description="give a number above 0")
    gamma: _Share = Field(default=0.99, description="give a number from 0 to 1")


class _Demonstrations(Closed):
    """Episodes of a controller, see :mod:`tiago_mj.learn.demonstrations`."""

    policy: str = Field(description="give the name of a controller: scripted, pi, pi-tuned, or an agent's")
    episodes: _Whole = Field(default=100, description=_WHOLE)
    noise: float = Field(default=0.1, ge=0, le=2, description="give a standard deviation, 0 to 2")
    updates: Annotated[int, Field(ge=0, le=10_000_000), BeforeValidator(_whole)] = Field(
        default=2000, description="give a whole number, 0 or more"
    )
    weight: float = Field(default=1.0, ge=0, le=1e6, description="give a number, 0 or more")
    keep: _Share = Field(default=0.0, description="give a share of the weight, 0 to 1")


class _Entry(Closed):
    n_timesteps: _Whole = Field(default=400_000, description=_WHOLE)
    n_envs: _Whole = Field(default=1, description=_WHOLE)
    hold: _Whole = Field(default=1, description=_WHOLE)
    hold_share: _Share = Field(default=0.0, description="give a share of the environments, 0 to 1")
    leak: _Share = Field(default=0.0, description="give a slope, 0 to 1")
    action_cost: float = Field(default=0.0, ge=0, le=1e6, description="give a number, 0 or more")
    value_range: Annotated[list[float] | None, BeforeValidator(_interval)] = Field(
        default=None, description="give [LOWEST, HIGHEST]"
    )
    demonstrations: Annotated[_Demonstrations | None, BeforeValidator(_mapping)] = Field(
        default=None, description=_MAPPING
    )
    expert: str = Field(default="scripted", description="give the name of a controller: scripted, or an agent's")
    policy: Literal["MlpPolicy", "MultiInputPolicy"] = Field(
        default="MlpPolicy", description="use 'MlpPolicy' or 'MultiInputPolicy'"
    )
    env_kwargs: _Mapping = Field(default={}, description=_MAPPING)
    policy_kwargs: Annotated[_PolicyArguments | None, BeforeValidator(_mapping)] = Field(
        default=None, description=_MAPPING
    )
    normalize: bool | Annotated[_Normalise, BeforeValidator(_mapping)] = Field(
        default=False, description="give true, false or a mapping"
    )
    noise_type: Literal["normal", "ornstein-uhlenbeck"] | None = Field(
        default=None, description=f"use one of {', '.join(NOISES)}"
    )
    noise_std: Annotated[Any, BeforeValidator(_deviation)] = Field(
        default=0.0, description="give a number, 0 or more, or 'lin_NUMBER' to fall to 0"
    )
    train_freq: Annotated[list[Any], BeforeValidator(_train_freq)] = Field(
        default=[1, "step"], description="give a number of steps, or [NUMBER, step or episode]"
    )
    replay_buffer_kwargs: _Mapping = Field(default={}, description=_MAPPING)
    others: _Numbers = Field(description="give a number, or 'lin_NUMBER' to fall to 0")


def shipped(algo: str) -> Traversable:
    """The file of hyperparameters that comes with the package.

    Raises:
        ValueError: there is no such algorithm.
    """
    if algo not in ALGORITHMS:
        raise ValueError(f"algorithm {quoted(algo)} is unknown: use one of {', '.join(ALGORITHMS)}")
    return files("tiago_mj.learn") / "hyperparameters" / f"{algo}.yml"


def read_hyperparameters(algo: str, env_id: str, path: Path | None = None) -> dict[str, Any]:
    """Hyperparameters of an environment, as plain data.

    Args:
        algo: of :data:`ALGORITHMS`.
        env_id: with or without its namespace.
        path: a YAML file; None: the one shipped for the algorithm.

    Raises:
        ValueError: no such algorithm or entry, no YAML, a key or value that cannot be used; one line.
        ModuleNotFoundError: stable-baselines3 is not installed.
    """
    source: Traversable | Path = shipped(algo) if path is None else path
    name = source.name if path is None else str(path)
    entries = load_yaml(source, f"hyperparameters {name} are no YAML")
    if not isinstance(entries, dict):
        raise ValueError(f"hyperparameters {name}: the top level must map environment ids to entries")
    short = env_id.removeprefix(f"{NAMESPACE}/")
    key = next((k for k in (short, f"{NAMESPACE}/{short}", DEFAULT) if k in entries), None)
    if key is None:
        raise ValueError(
            f"hyperparameters {name} have no entry for {quoted(short)}, nor {DEFAULT!r}: there are "
            f"{', '.join(map(str, entries)) or 'none'}"
        )
    where = f"hyperparameters {name}, entry {key}"
    if not isinstance(entries[key], dict):
        raise ValueError(f"{where}: an entry must map names to values, this is {quoted(entries[key])}")
    return checked(algo, entries[key], where)


def checked(algo: str, entry: Mapping[str, Any], where: str) -> dict[str, Any]:
    """An entry with known keys and values of the right type.

    Raises:
        ValueError: one is not; says which, where, and what is possible.
    """
    known = class_arguments(algo)
    for key in entry:
        if is_one_of(key, REFUSED):
            raise ValueError(f"{where}: {quoted(key)} is of rl-zoo3 but not supported here; leave it out")
        if not is_one_of(key, (*OWN_KEYS, *known)):
            names = ", ".join((*OWN_KEYS, *sorted(known)))
            raise ValueError(f"{where}: {quoted(key)} is unknown to {algo}: use {names}")
    own = {key: value for key, value in entry.items() if key in _Entry.model_fields}
    others = {key: value for key, value in entry.items() if key not in own}
    try:
        found = schema_checked(_Entry, {**own, "others": others})
    except SchemaError as fault:
        path = fault.path.removeprefix("others.")
        said = f"{path} {fault.problem}"
        if fault.problem == "is unknown":
            said = f"{fault.where[0]} has {quoted(fault.where[-1])}"
        raise ValueError(f"{where}: {said}: {fault.mend}") from fault
    always = ("n_timesteps", "n_envs", "policy", "env_kwargs", "normalize")
    values = found.model_dump(exclude_unset=True) | found.others
    defaults = {key: copy(_Entry.model_fields[key].default) for key in always if key not in entry}
    return {"policy_kwargs": {}} | {key: values[key] for key in entry} | defaults


def class_arguments(algo: str) -> frozenset[str]:
    """Arguments of the algorithm's class that an entry may set."""
    if algo not in ALGORITHMS:
        raise ValueError(f"algorithm {quoted(algo)} is unknown: use one of {', '.join(ALGORITHMS)}")
    known = frozenset(inspect.signature(sb3_class(algo).__init__).parameters) - _NOT_GIVEN
    return known - _OF_CRITICS if algo == "dagger" else known


def sb3_class(algo: str) -> Any:
    """The algorithm's class.

    Raises:
        ModuleNotFoundError: the extra is not installed.
    """
    return getattr(extra.load("stable_baselines3", "training", "train"), ALGORITHMS[algo])


def _value(node: ast.expr) -> Any:
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "dict" and not node.args:
        return {str(word.arg): _value(word.value) for word in node.keywords}
    if isinstance(node, ast.Dict):
        return {_value(k): _value(v) for k, v in zip(node.keys, node.values, strict=True) if k is not None}
    if isinstance(node, (ast.List, ast.Tuple)):
        return [_value(item) for item in node.elts]
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        return f"{node.value.id}.{node.attr}"
    return ast.literal_eval(node)
