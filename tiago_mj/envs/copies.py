"""Copies of an environment in mid-episode: what ``copy.deepcopy`` and ``pickle`` take along, and what is made anew."""

from __future__ import annotations

import copy
from typing import Any, Final

from gymnasium_robotics.envs import robot_env
from gymnasium_robotics.envs.robot_env import MujocoRobotEnv

#: Modules that gymnasium-robotics keeps in the environment, which no pickle holds.
MODULES: Final = ("_mujoco", "_utils")


def kept(env: MujocoRobotEnv) -> dict[str, Any]:
    """All attributes of an environment that a copy needs to go on from the same state to the last bit.

    The model is not among them: MuJoCo copies it with the data, and a second copy would be another model. The renderer
    goes without its OpenGL context or window, which belong to the original: a copy opens its own when it renders.
    """
    state = {name: value for name, value in vars(env).items() if name not in (*MODULES, "model")}
    renderer = copy.copy(env.mujoco_renderer)
    renderer.viewer, renderer._viewers = None, {}
    renderer.model = None
    state["mujoco_renderer"] = renderer
    return state


def restore(env: MujocoRobotEnv, state: dict[str, Any]) -> None:
    """Make a copy of what :func:`kept` gave."""
    vars(env).update(state)
    env.model = env.mujoco_renderer.model = env.data.model
    env._mujoco, env._utils = robot_env.mujoco, robot_env.mujoco_utils
