"""The base of every environment: a goal task of the simulated robot.

A task overrides what differs: ``_observation``, ``_achieved``, ``_draw_goal``, ``_is_success``, ``_reward_terms`` and,
where it places things, ``_object_position``.
"""

from __future__ import annotations

import operator
import warnings
from abc import abstractmethod
from collections.abc import Mapping
from functools import reduce
from typing import Any, SupportsFloat

import numpy as np
from gymnasium import error, spaces
from numpy.typing import NDArray

from tiago_mj.envs import checks
from tiago_mj.envs.simulation import RobotSimulation
from tiago_mj.envs.state import State

Array = NDArray[np.float64]

#: Bounds of the observation spaces. Measured positions may exceed a joint's range by half, as an encoder's wrong scale
#: makes them, and by what its soft limit and a bias give [rad, m]; velocities
#: [rad/s, m/s] and forces [N] are bounded far above anything that the limits of the robot allow.
POSITION_SHARE, POSITION_MARGIN = 1.5, 0.5
VELOCITY_BOUND, FORCE_BOUND, WORLD_BOUND = 100.0, 2000.0, 10.0
#: Zero as an array, which NumPy would make of the number at every comparison.
_NOTHING = np.array(0.0)


def added(terms: Mapping[str, Any]) -> Any:
    """The sum of a reward's terms, in their order and each rounded, of one environment as of many; no view of a term.

    Since Python 3.12 ``sum`` makes up for the rounding of floats, and not of arrays.
    """
    return reduce(operator.add, terms.values(), 0.0)


class RobotEnv(RobotSimulation):
    """What is seen, asked and rewarded, on the simulation and with its arguments: :class:`RobotSimulation`."""

    #: Whether an episode has begun, whether its simulation has diverged, and whether the environment was closed.
    _begun = _gone = _closed = False
    _goal: Array

    # Hooks of a task -----------------------------------------------------------------------------------------------

    @abstractmethod
    def _observation(self, state: State) -> Array:
        """What the agent sees apart from goals, (..., n)."""

    @abstractmethod
    def _observation_bound(self) -> Array:
        """Largest magnitude of every entry of :meth:`_observation`, (n,)."""

    @abstractmethod
    def _achieved(self, state: State) -> Array:
        """The achieved goal, (..., g)."""

    @abstractmethod
    def _goal_bound(self) -> Array:
        """Largest magnitude of the achieved and desired goal, (g,)."""

    @abstractmethod
    def _reward_terms(self, achieved: Array, desired: Array) -> dict[str, Array]:
        """Named parts whose sum is the reward, each (...)."""

    @abstractmethod
    def _draw_goal(self, rng: np.random.Generator, object_place: Array) -> Array:
        """The goal of one episode, (g,); the middle of the object starts at ``object_place``, (3,) [m], or (0,)."""

    # gymnasium-robotics' hooks --------------------------------------------------------------------------------------

    def _sample_goal(self) -> Array:
        return self._draw_goal(self.np_random, self.state.object_pose[:3])

    def _reset_sim(self) -> bool:
        done = super()._reset_sim()
        self._begun, self._gone = True, False
        return done

    def _get_obs(self) -> dict[str, Array]:
        return self.observed(self.state, self._goal)

    def bounds(self) -> tuple[Array, Array]:
        """Largest magnitudes of the observation's entries, (n,), and of the goal's, (g,)."""
        return self._observation_bound(), self._goal_bound()

    def draw_goal(self, rng: np.random.Generator, object_place: Array) -> Array:
        """The goal of one episode, (g,), drawn as the task says; ``object_place`` as for :meth:`_draw_goal`."""
        return self._draw_goal(rng, object_place)

    def checked_goal(self, goal: Any) -> Array:
        """A goal that a user gives, (g,).

        Raises:
            ValueError: it cannot be reached, has another shape or is not finite.
        """
        return self._checked_goal(goal)

    def observed(self, state: State, goal: Array) -> dict[str, Array]:
        """The observation, of one simulation or of many (leading axes of every array)."""
        return {
            "observation": self._observation(state),
            "achieved_goal": self._achieved(state),
            "desired_goal": goal.copy(),
        }

    @property
    def goal(self) -> Array:
        """What is asked in this episode, (g,). Set, it acts from the next step on.

        Raises:
            ValueError: it cannot be reached, has another shape or is not finite.
        """
        return self._goal

    @goal.setter
    def goal(self, goal: Any) -> None:
        made = "observation_space" in vars(self)  # before that there is no goal to be checked
        self._goal = self._checked_goal(goal) if made else goal

    # gymnasium's interface ------------------------------------------------------------------------------------------

    def step(self, action: Any) -> tuple[dict[str, Array], SupportsFloat, bool, bool, dict[str, Any]]:
        """Apply an action for one control period.

        Args:
            action: (n_actions,), clipped to [-1, 1].

        Returns:
            Observation, reward, terminated (never), truncated (the simulation has diverged: all else is then of the
            state before this step, and a warning tells; time is limited by a wrapper), info (see the task).

        Raises:
            ValueError: the action has another shape, is not numeric or not finite. The simulation is unchanged.
            gymnasium.error.ResetNeeded: no episode has begun, or it has diverged.
            gymnasium.error.ClosedEnvironmentError: the environment was closed.
        """
        if not self._begun or self._gone:
            checks.begun(self._begun, self._closed, "step")
            raise error.ResetNeeded("this episode's simulation has diverged: call reset() first")
        before = self.state
        self._set_action(checks.action_in_range(action, self.joints))
        self._mujoco_step(self.command)
        self._read()
        if self.diverged:  # MuJoCo has begun anew: what it shows is of no episode
            self.state, self._gone = State(*(part.copy() for part in before)), True
            warnings.warn("the simulation has diverged: its episode is truncated", RuntimeWarning, stacklevel=2)
        self._step_callback()
        if self.render_mode == "human":
            self.render()
        observation = self._get_obs()
        achieved, goal = observation["achieved_goal"], self._goal
        info = self._info(achieved)
        return (
            observation,
            float(added(info["reward_terms"])),
            bool(self.compute_terminated(achieved, goal, info)),
            self._gone or bool(self.compute_truncated(achieved, goal, info)),
            info,
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Start an episode.

        Args:
            seed: seeds everything that is drawn; the only source of randomness.
            options: ``{"goal": ...}`` sets this episode's goal instead of drawing it.

        Raises:
            ValueError: an option is unknown, or the goal cannot be reached or has another shape.
            gymnasium.error.ClosedEnvironmentError: the environment was closed.
        """
        if self._closed:
            raise checks.closed()
        chosen = checks.reset_options(options, ("goal",))
        goal = self._checked_goal(chosen["goal"]) if "goal" in chosen else None
        super().reset(seed=seed)
        if goal is not None:
            self.goal = goal
        observation = self._get_obs()
        return observation, self._info(observation["achieved_goal"])

    def close(self) -> None:
        """Release the renderer; the environment can be stepped, reset and rendered no more."""
        super().close()
        self._begun, self._closed = False, True

    def render(self) -> Any:
        """As :class:`RobotSimulation` says.

        Raises:
            gymnasium.error.ResetNeeded: no episode has begun.
            gymnasium.error.ClosedEnvironmentError: the environment was closed.
        """
        if not self._begun:
            checks.begun(self._begun, self._closed, "render")
        return super().render()

    def show(self, goal: Array) -> Any:
        """Render what ``model`` and ``data`` hold as an episode in which ``goal``, (g,), is asked."""
        self._goal, self._begun = goal, True
        return self.render()

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """Reward of reaching ``achieved_goal`` where ``desired_goal`` was asked; over leading batch axes, as HER needs.

        Args:
            achieved_goal, desired_goal: (..., g).
            info: unused; the reward depends on the goals alone.

        Returns:
            A float for single goals, else (...).
        """
        total = added(self._reward_terms(np.asarray(achieved_goal), np.asarray(desired_goal)))
        return float(total) if np.ndim(total) == 0 else total

    # Parts ----------------------------------------------------------------------------------------------------------

    def _info(self, achieved: Array) -> dict[str, Any]:
        info = self.described(self.state, achieved, self._goal)
        terms = info["reward_terms"]
        for name in terms:
            terms[name] = float(terms[name])
        return info

    def described(self, state: State, achieved: Array, goal: Array) -> dict[str, Any]:
        """What ``info`` holds, of one simulation or of many (leading axes of every array)."""
        return {
            "force_contact": state.force_contact,
            "force_raw": state.force_raw,
            "force_binary": state.force_binary,
            "in_contact": state.force_contact > _NOTHING,
            "object_velocity": state.object_velocity,
            "goal": goal.copy(),
            "reward_terms": self._reward_terms(achieved, goal),
            "is_success": self._is_success(achieved, goal),
        }

    def _checked_goal(self, goal: Any) -> Array:
        """A goal that a user gave, as (g,)."""
        return checks.goal_numbers(goal, len(self._goal_bound()))

    def _joint_bound(self) -> Array:
        """Largest magnitude of (q, q̇), (2N,)."""
        position = POSITION_SHARE * np.abs(self._range).max(axis=1) + POSITION_MARGIN
        return np.concatenate([position, np.full(len(self.joints), VELOCITY_BOUND)])

    def _observation_space(self) -> spaces.Dict:
        def box(bound: Array) -> spaces.Box:
            return spaces.Box(-bound, bound, dtype=np.float64)

        goal = self._goal_bound()
        return spaces.Dict(
            {"observation": box(self._observation_bound()), "achieved_goal": box(goal), "desired_goal": box(goal)}
        )
