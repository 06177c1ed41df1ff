"""Hyperparameters in rl-zoo3's YAML form: one entry an environment, read and checked before anything starts.

An entry has rl-zoo3's own keys (:data:`OWN_KEYS`; ``hold``, ``hold_share`` and ``leak`` are ours) and arguments of the
algorithm's class. What rl-zoo3 would run as Python (``policy_kwargs: "dict(net_arch=[400, 300])"``) is read as the
literal that it is; nothing is evaluated.
"""

from __future__ import annotations

import ast
import inspect
import math
from collections.abc import Mapping
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, Final

import yaml

from tiago_mj import extra
from tiago_mj.registration import NAMESPACE

#: Algorithm: class of stable-baselines3. The hyperparameters shipped for it are ``hyperparameters/NAME.yml``.
ALGORITHMS: Final[Mapping[str, str]] = {
    "td3": "TD3",
    "ddpg": "DDPG",
    "sac": "SAC",
    "ppo": "PPO",
    "a2c": "A2C",
    "her-td3": "TD3",
}
#: Of :class:`tiago_mj.learn.updates.FastTD3`, beyond rl-zoo3's.
FAST_KEYS: Final = ("hold", "hold_share", "leak")
#: Keys of an entry that are not the class's arguments.
OWN_KEYS: Final = ("n_timesteps", "n_envs", "policy", "env_kwargs", "normalize", "noise_type", "noise_std", *FAST_KEYS)
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
NOISES: Final = ("normal", "ornstein-uhlenbeck")
#: Of ``policy_kwargs``: what an exported agent can be made of.
POLICY_KEYS: Final = ("net_arch", "activation_fn", "n_critics", "log_std_init", "ortho_init")
ACTIVATIONS: Final = ("ReLU", "Tanh", "ELU")
NORMALISE_KEYS: Final = ("norm_obs", "norm_reward", "clip_obs", "gamma")
#: The entry for environments that have none of their own.
DEFAULT: Final = "default"


def shipped(algo: str) -> Traversable:
    """The file of hyperparameters that comes with the package.

    Raises:
        ValueError: there is no such algorithm.
    """
    if algo not in ALGORITHMS:
        raise ValueError(f"algorithm {algo!r} is unknown: use one of {', '.join(ALGORITHMS)}")
    return files("tiago_mj.learn") / "hyperparameters" / f"{algo}.yml"


def read_hyperparameters(algo: str, env_id: str, path: Path | None = None) -> dict[str, Any]:
    """The entry of an environment, as plain data.

    Args:
        algo: of :data:`ALGORITHMS`.
        env_id: with or without its namespace.
        path: a YAML file; None: the one shipped for the algorithm.

    Raises:
        ValueError: no such algorithm or entry, no YAML, a key or value that cannot be used; one line.
        OSError: the file cannot be read.
        ModuleNotFoundError: stable-baselines3 is not installed.
    """
    source: Traversable | Path = shipped(algo) if path is None else path
    name = source.name if path is None else str(path)
    try:
        entries = yaml.safe_load(source.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as fault:
        raise ValueError(f"hyperparameters {name} are no YAML: {' '.join(str(fault).split())}") from fault
    if not isinstance(entries, dict):
        raise ValueError(f"hyperparameters {name}: the top level must map environment ids to entries")
    short = env_id.removeprefix(f"{NAMESPACE}/")
    key = next((k for k in (short, f"{NAMESPACE}/{short}", DEFAULT) if k in entries), None)
    if key is None:
        raise ValueError(
            f"hyperparameters {name} have no entry for {short!r}, nor {DEFAULT!r}: there are "
            f"{', '.join(map(str, entries)) or 'none'}"
        )
    where = f"hyperparameters {name}, entry {key}"
    if not isinstance(entries[key], dict):
        raise ValueError(f"{where}: an entry must map names to values, this is {entries[key]!r}")
    return checked(algo, entries[key], where)


def checked(algo: str, entry: Mapping[str, Any], where: str) -> dict[str, Any]:
    """An entry whose keys are known and whose values have the right form.

    Raises:
        ValueError: one is not; says which, where, and what is possible.
    """
    known = class_arguments(algo)
    values = dict(entry)
    for key in values:
        if key in REFUSED:
            raise ValueError(f"{where}: {key!r} is of rl-zoo3 but not supported here; leave it out")
        if key not in OWN_KEYS and key not in known:
            raise ValueError(f"{where}: {key!r} is unknown to {algo}: use {', '.join((*OWN_KEYS, *sorted(known)))}")
    for key in ("n_timesteps", "n_envs"):
        values.setdefault(key, 1 if key == "n_envs" else 400_000)
        values[key] = _whole(where, key, values[key])
    if "hold" in values:
        values["hold"] = _whole(where, "hold", values["hold"])
    for key, what in (("hold_share", "a share of the environments"), ("leak", "a slope")):
        share = values.get(key, 0.0)
        if isinstance(share, bool) or not isinstance(share, (int, float)) or not 0 <= share <= 1:
            raise ValueError(f"{where}: {key} is {share!r}: give {what}, 0 to 1")
    values.setdefault("policy", "MlpPolicy")
    if values["policy"] not in ("MlpPolicy", "MultiInputPolicy"):
        raise ValueError(f"{where}: policy is {values['policy']!r}: use 'MlpPolicy' or 'MultiInputPolicy'")
    values["env_kwargs"] = _mapping(where, "env_kwargs", values.get("env_kwargs"))
    values["policy_kwargs"] = _policy_arguments(where, values.get("policy_kwargs"))
    if values.get("noise_type") not in (None, *NOISES):
        raise ValueError(f"{where}: noise_type is {values['noise_type']!r}: use one of {', '.join(NOISES)}")
    values["normalize"] = _normalize(where, values.get("normalize", False))
    if "train_freq" in values:
        values["train_freq"] = _train_freq(where, values["train_freq"])
    if "replay_buffer_kwargs" in values:
        values["replay_buffer_kwargs"] = _mapping(where, "replay_buffer_kwargs", values["replay_buffer_kwargs"])
    for key in set(values) - {*OWN_KEYS, "policy_kwargs", "replay_buffer_kwargs", "train_freq"} | {"noise_std"}:
        if key in values:
            values[key] = _number(where, key, values[key])
    deviation = values.get("noise_std", 0.0)
    start = deviation.removeprefix("lin_") if isinstance(deviation, str) else deviation
    usable = isinstance(deviation, (int, float, str)) and not str(start).startswith("auto")
    if not usable or not 0 <= float(start) < math.inf:
        raise ValueError(f"{where}: noise_std is {deviation!r}: give a number, 0 or more, or 'lin_NUMBER' to fall to 0")
    return values


def class_arguments(algo: str) -> frozenset[str]:
    """Arguments of the algorithm's class that an entry may have."""
    if algo not in ALGORITHMS:
        raise ValueError(f"algorithm {algo!r} is unknown: use one of {', '.join(ALGORITHMS)}")
    return frozenset(inspect.signature(sb3_class(algo).__init__).parameters) - _NOT_GIVEN


def sb3_class(algo: str) -> Any:
    """The algorithm's class.

    Raises:
        ModuleNotFoundError: the extra is not installed.
    """
    return getattr(extra.load("stable_baselines3", "training", "train"), ALGORITHMS[algo])


def _whole(where: str, key: str, value: Any) -> int:
    try:
        number = float(value)  # YAML 1.1 reads 4e5 as text, 4.0e+5 as a number
    except (TypeError, ValueError):
        number = 0.5
    if isinstance(value, bool) or not number.is_integer() or number < 1:
        raise ValueError(f"{where}: {key} is {value!r}: give a whole number, 1 or more")
    return int(number)


def _mapping(where: str, key: str, value: Any) -> dict[str, Any]:
    if isinstance(value, str):
        value = _literal(where, key, value)
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise ValueError(f"{where}: {key} is {value!r}: give a mapping")
    return dict(value)


def _policy_arguments(where: str, value: Any) -> dict[str, Any]:
    given = _mapping(where, "policy_kwargs", value)
    for key in given:
        if key not in POLICY_KEYS:
            raise ValueError(f"{where}: policy_kwargs has {key!r}: use {', '.join(POLICY_KEYS)}")
    if "activation_fn" in given:
        name = str(given["activation_fn"]).removeprefix("nn.")
        if name not in ACTIVATIONS:
            raise ValueError(f"{where}: activation_fn is {name!r}: use {', '.join(f'nn.{a}' for a in ACTIVATIONS)}")
        given["activation_fn"] = name
    return given


def _number(where: str, key: str, value: Any) -> Any:
    """A number, truth value or nothing; of text: a number, ``lin_NUMBER``, or a word that starts with ``auto``."""
    if isinstance(value, str) and not value.startswith("auto"):
        try:
            number = float(value.removeprefix("lin_"))
        except ValueError:
            raise ValueError(f"{where}: {key} is {value!r}: give a number, or 'lin_NUMBER' to fall to 0") from None
        return value if value.startswith("lin_") else number  # YAML 1.1 reads 1e-3 as text
    if isinstance(value, (list, dict)) or (isinstance(value, float) and not math.isfinite(value)):
        raise ValueError(f"{where}: {key} is {value!r}: give a number")
    return value


def _train_freq(where: str, value: Any) -> int | list[Any]:
    pair = [value, "step"] if not isinstance(value, list) else value
    if len(pair) != 2 or pair[1] not in ("step", "episode"):
        raise ValueError(f"{where}: train_freq is {value!r}: give a number of steps, or [NUMBER, step or episode]")
    return [_whole(where, "train_freq", pair[0]), pair[1]]


def _normalize(where: str, value: Any) -> bool | dict[str, Any]:
    if isinstance(value, bool):
        return value
    given = _mapping(where, "normalize", value)
    for key in given:
        if key not in NORMALISE_KEYS:
            raise ValueError(f"{where}: normalize has {key!r}: use {', '.join(NORMALISE_KEYS)}")
    return given


def _literal(where: str, key: str, text: str) -> Any:
    """The value of ``dict(net_arch=[400, 300], activation_fn=nn.ReLU)`` and the like, without running it."""
    try:
        return _value(ast.parse(text, mode="eval").body)
    except (SyntaxError, ValueError) as fault:
        raise ValueError(f"{where}: {key} is {text!r}: give a mapping, or dict(NAME=VALUE, ...)") from fault


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
