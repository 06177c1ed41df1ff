"""Domain randomisation: every training episode has a simulator of its own, drawn from ranges of effects.

The ranges are a file such as

    command_delay: {seconds: [0.0, 0.03]}
    servo_stiffness: {factor: [0.5, 2.0]}

whose names are those of docs/effects.md. A factor is drawn log-uniformly, everything else uniformly; one draw serves
all targets of an effect. A simulator is made in some 20 ms, a tenth of what an episode takes, so it is made anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from tiago_mj.effects import EFFECTS, read_effects
from tiago_mj.io.quoting import is_number, quoted, unquoted

Ranges = Mapping[str, Mapping[str, Sequence[float]]]


def read_ranges(given: Any, where: str) -> dict[str, dict[str, list[float]]]:
    """Ranges that are checked.

    Args:
        given: effect name to parameter name to ``[low, high]`` or one number.
        where: what to call it in a complaint.

    Raises:
        ValueError: it has another form, an effect or parameter is unknown, or a value is impossible; one line.
    """
    if not isinstance(given, Mapping) or not given:
        raise ValueError(f"{where}: give effects with ranges, such as 'command_delay: {{seconds: [0, 0.03]}}'")
    ranges: dict[str, dict[str, list[float]]] = {}
    for name, parameters in given.items():
        if not isinstance(parameters, Mapping) or not parameters:
            raise ValueError(f"{where}: {unquoted(name)} needs a range of a parameter, such as {{seconds: [0, 0.03]}}")
        ranges[str(name)] = {str(key): _range(where, f"{name}.{key}", value) for key, value in parameters.items()}
    for end in (0, 1):
        try:
            read_effects({name: {key: pair[end] for key, pair in one.items()} for name, one in ranges.items()})
        except ValueError as fault:
            raise ValueError(f"{where}: {fault}") from fault
    return ranges


def draw(ranges: Ranges, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Effects of one simulator, as environments take them."""
    drawn = []
    for name, parameters in ranges.items():
        values = {}
        for key, (low, high) in parameters.items():
            if EFFECTS[name].parameters[key].identity == 1.0 and low > 0:
                values[key] = math.exp(rng.uniform(math.log(low), math.log(high)))
            else:
                values[key] = float(rng.uniform(low, high))
        drawn.append({"name": name, "parameters": values})
    return drawn


class Randomised(VecEnv):  # type: ignore[misc]
    """Single environments side by side, each with another simulator in every episode.

    Args:
        make: an environment of one for stable-baselines3, with these effects in it.
        count: environments.
        ranges: of :func:`read_ranges`.
    """

    def __init__(self, make: Callable[[Sequence[Any]], VecEnv], count: int, ranges: Ranges) -> None:
        self._make, self._ranges = make, ranges
        self._generators = [np.random.default_rng(k) for k in range(count)]
        self._each: list[VecEnv] = [make([]) for _ in range(count)]
        first = self._each[0]
        super().__init__(count, first.observation_space, first.action_space)
        self._actions: NDArray[Any] = np.zeros((count, *first.action_space.shape), dtype=np.float32)

    def reset(self) -> Any:
        """New simulators and episodes for all; what they draw follows from the seeds that were set."""
        for k, seed in enumerate(self._seeds):
            if seed is not None:
                self._generators[k] = np.random.default_rng(seed)
        self._reset_seeds()
        self._reset_options()
        return _stacked([self._begin(k) for k in range(self.num_envs)])

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions, (num_envs, n), of the next step."""
        self._actions = np.asarray(actions)

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """As of stable-baselines3; the observation after an episode's end is that of another simulator."""
        seen, rewards, dones, infos = [], [], [], []
        for k, env in enumerate(self._each):
            observation, reward, done, info = env.step(self._actions[k : k + 1])
            seen.append(self._begin(k) if done[0] else _only(observation))
            rewards.append(reward[0])
            dones.append(bool(done[0]))
            infos.append(info[0])
        return _stacked(seen), np.array(rewards, dtype=np.float32), np.array(dones), infos

    def _begin(self, k: int) -> Any:
        self._each[k].close()
        rng = self._generators[k]
        env = self._make(draw(self._ranges, rng))
        env.seed(int(rng.integers(2**31)))
        self._each[k] = env
        return _only(env.reset())

    def close(self) -> None:
        """Release every environment."""
        for env in self._each:
            env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of the environments."""
        return [self._each[k].get_attr(attr_name)[0] for k in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refused: the environments are made anew in every episode."""
        raise AttributeError(f"{attr_name!r} cannot be set: the environments are made anew in every episode")

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Call a method of the environments, as HER does."""
        chosen = self._get_indices(indices)
        return [self._each[k].env_method(method_name, *method_args, **method_kwargs)[0] for k in chosen]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """See :class:`tiago_mj.vector.sb3.SB3VecEnv`."""
        return [self._each[k].env_is_wrapped(wrapper_class)[0] for k in self._get_indices(indices)]


def _range(where: str, name: str, value: Any) -> list[float]:
    pair = list(value) if isinstance(value, (list, tuple)) else [value, value]
    if len(pair) != 2 or not all(map(is_number, pair)) or pair[0] > pair[1]:
        raise ValueError(f"{where}: {unquoted(name)} is {quoted(value)}: give [low, high], or one number")
    return [float(one) for one in pair]


def _only(observation: Any) -> Any:
    """Of the only environment."""
    return {key: part[0] for key, part in observation.items()} if isinstance(observation, dict) else observation[0]


def _stacked(observations: Sequence[Any]) -> Any:
    if isinstance(observations[0], dict):
        return {key: np.stack([one[key] for one in observations]) for key in observations[0]}
    return np.stack(observations)
