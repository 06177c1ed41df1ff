"""The vector environment for stable-baselines3, which takes no gymnasium ``VectorEnv`` by itself.

    from stable_baselines3 import PPO
    from tiago_mj.vector.sb3 import make_sb3

    model = PPO("MlpPolicy", make_sb3("tiago_mj/GripperTactile-v0", num_envs=64, seed=0))

Needs the extra ``train``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor

from tiago_mj.io import extra
from tiago_mj.vector.env import VectorRobotEnv

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as missing:
    raise ImportError(f"stable-baselines3 is not installed: {extra.install('train')}") from missing

#: What stable-baselines3 calls by name, and depends on no simulation: HER's relabelling.
_METHODS: Final = ("compute_reward", "compute_terminated", "compute_truncated")


def make_sb3(env_id: str, num_envs: int, *, seed: int | None = None, **arguments: Any) -> SB3VecEnv:
    """Build a vector environment of an id for stable-baselines3.

    Args:
        env_id: ``tiago_mj/...``.
        num_envs: how many.
        seed: of the first; the others' follow. Used at the next reset.
        **arguments: of the environment and of :class:`tiago_mj.vector.env.VectorRobotEnv`.
    """
    given: dict[str, Any] = {"episode_statistics": True, **arguments}
    made: Any = gymnasium.make_vec(env_id, num_envs=num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **given)
    env = SB3VecEnv(made.unwrapped)
    env.seed(seed)
    return env


class SB3VecEnv(VecEnv):  # type: ignore[misc]
    """A :class:`VectorRobotEnv` as stable-baselines3's ``VecEnv``.

    An episode that ends is followed by the next at once; its last observation is ``terminal_observation``, and its
    ``episode`` has return and length as ``Monitor`` gives them, in that environment's info.

    Args:
        envs: made with ``autoreset_mode="SameStep"`` and, for ``episode``, ``episode_statistics=True``.
        info_keys: what of ``info`` every step's dictionaries have. At the end of an episode they have all of it.

    Raises:
        ValueError: the environment begins its episodes at another time.
    """

    def __init__(self, envs: VectorRobotEnv, info_keys: Sequence[str] = ("is_success",)) -> None:
        if envs.autoreset_mode != AutoresetMode.SAME_STEP:
            raise ValueError(
                f"autoreset_mode is {envs.autoreset_mode.value!r}: stable-baselines3 needs 'SameStep', as make_sb3 sets"
            )
        self.envs = envs
        self._keys = tuple(info_keys)
        self._actions: Any = None
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self) -> Any:
        """Begin an episode of every environment, with the seeds and options that were set for it."""
        seeds = list(self._seeds)
        observation, info = self.envs.reset(seed=seeds, options=self._together(self._options))
        self.reset_infos = [one(info, k) for k in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: Any) -> None:
        """Take the actions, (num_envs, n), of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Step; observations, rewards (num_envs,), dones (num_envs,), and an info dictionary an environment."""
        observation, reward, terminated, truncated, info = self.envs.step(self._actions)
        done = terminated | truncated
        shown = [np.asarray(info[key]).tolist() for key in self._keys]
        infos: list[dict[str, Any]] = [
            dict(zip((*self._keys, "TimeLimit.truncated"), (*values, False), strict=True))
            for values in zip(*shown, strict=True)
        ]
        if not self._keys:
            infos = [{"TimeLimit.truncated": False} for _ in range(self.num_envs)]
        for k in np.flatnonzero(done).tolist():
            infos[k] = {
                **one(info["final_info"], k),
                "diverged": int(info["diverged"][k]),
                "TimeLimit.truncated": bool(truncated[k] and not terminated[k]),
                "terminal_observation": info["final_obs"][k],
            }
            if "episode" in info:
                infos[k]["episode"] = {key: value[k].item() for key, value in info["episode"].items()}
        return observation, reward.astype(np.float32), done, infos

    def close(self) -> None:
        """Release the renderer."""
        self.envs.close()

    def get_images(self) -> Sequence[Any]:
        """A frame of every environment."""
        frames = self.envs.render() if self.render_mode == "rgb_array" else None
        return [None] * self.num_envs if frames is None else list(frames)

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of the scalar environment that all are copies of, once an index."""
        holder = self.envs if attr_name in ("spec", "metadata") else self.envs.one
        return [getattr(holder, attr_name) for _ in self._chosen(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refused: the copies share one scalar environment."""
        raise AttributeError(f"{attr_name!r} cannot be set: give it to make_sb3, all environments have the same")

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Call ``compute_reward``, ``compute_terminated`` or ``compute_truncated``, as HER does."""
        if method_name not in _METHODS:
            raise AttributeError(
                f"{method_name!r} cannot be called on one environment: there are {', '.join(_METHODS)}"
            )
        method = getattr(self.envs.one, method_name)
        return [method(*method_args, **method_kwargs) for _ in self._chosen(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Nothing is wrapped; returns and lengths are recorded without ``Monitor``."""
        return [issubclass(wrapper_class, Monitor) for _ in self._chosen(indices)]

    def _chosen(self, indices: Any) -> Iterable[int]:
        return self._get_indices(indices)

    def _together(self, options: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """Options of all environments from one dictionary each."""
        if not any(options):
            return {}
        if any(set(given) != {"goal"} for given in options):
            raise ValueError("options of environments differ or are unknown: give every one a 'goal', or none")
        return {"goal": np.array([self.envs.core.checked_goal(given["goal"]) for given in options])}


def one(info: Mapping[str, Any], k: int) -> dict[str, Any]:
    """What a vector environment's ``info`` says of environment ``k``."""
    return {
        key: one(value, k) if isinstance(value, Mapping) else value[k]
        for key, value in info.items()
        if not key.startswith("_")
    }
