"""``gymnasium.make_vec(ID, num_envs=N)``: N environments in one, stepped by all processors."""

from __future__ import annotations

import warnings
from typing import Any

import mujoco
import numpy as np
from gymnasium import error
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from tiago_mj.envs import checks
from tiago_mj.envs.flat import FlatView
from tiago_mj.envs.robot_env import RobotEnv, added
from tiago_mj.vector import given, report
from tiago_mj.vector.cohorts import DrawEffects
from tiago_mj.vector.simulations import Simulations

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rows = NDArray[np.intp]


class VectorRobotEnv(VectorEnv[Any, Any, Any]):
    """N copies of an environment of the table, bit for bit what N scalar ones do.

    Environment i depends on its own seed and actions alone: neither on the others nor on the number of threads. An
    integer seed gives it ``seed + i``, as gymnasium's SyncVectorEnv does.

    ``info`` has what the scalar environments' has, as arrays over the environments with gymnasium's masks (``_key``),
    and:

    | key | meaning |
    |---|---|
    | `episode` | with `episode_statistics`, of episodes that ended: return `r`, length `l`, seconds `t` |
    | `final_obs`, `final_info` | with `SameStep`: the last ones of episodes that ended |
    | `diverged` | how often each simulation has diverged so far |
    | `action_refused` | rows of actions that were not finite; absent where there were none |

    A row that is not finite commands nothing: that environment's set points stay where they are in this step, and a
    warning names it. A simulation that diverges is truncated with its last good observation, and its next episode is a
    new one; a warning names it. The others go on as if nothing had been.

    Args:
        one: the scalar environment, or its flat view; it is used up.
        num_envs: N.
        max_episode_steps: time limit [control steps]; None for none.
        autoreset_mode: ``NextStep`` (gymnasium's default), ``SameStep`` or ``Disabled`` (then
            ``reset(options={"reset_mask": ...})`` begins the next episodes of those that ended).
        threads: to step on; 0: one a processor.
        episode_statistics: whether ``info`` has ``episode``, which is otherwise left to gymnasium's
            RecordEpisodeStatistics.
        draw_effects: of an environment's generator the effects of its next episode, beside those that it always has;
            None: none are drawn.

    Raises:
        ValueError: an argument is unusable, or there is not enough memory; one line.
    """

    def __init__(
        self,
        one: RobotEnv | FlatView,
        num_envs: int,
        *,
        max_episode_steps: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        threads: int = 0,
        episode_statistics: bool = False,
        draw_effects: DrawEffects | None = None,
    ) -> None:
        self.autoreset_mode = given.autoreset(autoreset_mode)
        self._limit = given.time_limit(max_episode_steps)
        self.one = one
        self._flat = one if isinstance(one, FlatView) else None
        self.core: RobotEnv = one.core if isinstance(one, FlatView) else one
        if one.render_mode == "human":
            raise ValueError("render_mode 'human' shows one environment: use gymnasium.make, or 'rgb_array'")
        self.num_envs = given.number_of_simulations(num_envs, Simulations.memory(self.core))
        self.threads = given.number_of_threads(threads, self.num_envs)
        self.render_mode = one.render_mode
        self.metadata = {**one.metadata, "autoreset_mode": self.autoreset_mode}
        self.single_observation_space = one.observation_space
        self.single_action_space = one.action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.simulations = Simulations(self.core, self.num_envs, self.threads, draw_effects)
        self._seeds: list[int | None] = [None] * self.num_envs
        self._shape = (self.num_envs, len(self.core.joints))
        self._statistics = episode_statistics
        self._episodes = report.Episodes(self.num_envs)
        self._everyone = _everyone(self.num_envs)
        self._begun = np.zeros(self.num_envs, dtype=bool)
        self._ended = np.zeros(self.num_envs, dtype=bool)
        self._ready = self._over = False  # whether all have begun, and whether any has ended
        self._diverged = np.zeros(self.num_envs, dtype=np.int64)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """A copy, in mid-episode too; see :mod:`tiago_mj.vector.batch`."""
        vars(self).update(state, _everyone=_everyone(state["num_envs"]))

    # gymnasium's interface ------------------------------------------------------------------------------------------

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode of every environment.

        Args:
            seed: environment i gets ``seed + i``; a list has one each; None goes on with the present generators.
            options: ``goal``: of these episodes, (g,), or (num_envs, g) for one each; ``reset_mask``: (num_envs,) bool,
                which to start, all the others stay as they are.

        Raises:
            ValueError: a seed, an option or a goal is unusable. Nothing is changed then.
        """
        self._check_open()
        chosen = checks.reset_options(options, ("goal", "reset_mask"))
        rows = np.arange(self.num_envs)
        if "reset_mask" in chosen:
            rows = given.rows_to_reset(chosen["reset_mask"], self.num_envs)
        goal = self._goals(chosen["goal"]) if "goal" in chosen else None
        listed = given.seeds(seed, self.num_envs)
        for row in rows.tolist():
            if (one := listed[row]) is not None:
                self.simulations.generators[row] = seeding.np_random(one)[0]
                self._seeds[row] = one
        self._restart(rows)
        if goal is not None:
            self.simulations.goal[rows] = goal[rows]
        mask = np.isin(np.arange(self.num_envs), rows)
        observation, facts = self._seen()
        return self._shown(observation), report.of_some(facts, mask)

    def step(self, actions: Any) -> tuple[Any, Array, Mask, Mask, dict[str, Any]]:
        """Apply an action to every environment for one control period.

        Args:
            actions: (num_envs, N), clipped to [-1, 1].

        Returns:
            Observations, rewards (num_envs,), terminated (num_envs,), truncated (num_envs,), info (see the class).

        Raises:
            ValueError: the actions are not numeric or of another shape. Nothing is changed then.
            gymnasium.error.ResetNeeded: an environment was never reset, or has ended and is not reset by itself.
            gymnasium.error.ClosedEnvironmentError: they were closed.
        """
        self._check_open()
        command, refused = given.actions_in_range(actions, self._shape)
        self._check_begun()
        starting = None
        if self._over and self.autoreset_mode == AutoresetMode.NEXT_STEP:
            starting = self._ended.copy()
        if refused is not None and starting is not None:
            refused = refused & ~starting  # their actions are not used
        rows = None if starting is None else np.flatnonzero(~starting)
        diverged = self._advance(command, refused, rows)
        if starting is not None:
            self._restart(np.flatnonzero(starting))
        observation, facts = self._seen()
        reward = np.asarray(added(facts["reward_terms"]), dtype=np.float64)
        achieved, goal = observation["achieved_goal"], self.simulations.goal
        terminated = self._flags(self.core.compute_terminated(achieved, goal, facts))
        truncated = self._flags(self.core.compute_truncated(achieved, goal, facts))
        self._episodes.add(reward, None if starting is None else ~starting)
        if self._limit is not None:
            truncated |= self._episodes.length >= self._limit
        if len(diverged):
            truncated[diverged] = True
        if starting is not None:
            reward[starting], terminated[starting], truncated[starting] = 0.0, False, False
        self._ended = terminated | truncated
        self._over = bool(np.count_nonzero(self._ended))
        observation, info = self._at_end(observation, facts)
        if refused is not None:
            info["action_refused"], info["_action_refused"] = refused, self._everyone
        return self._shown(observation), reward, terminated, truncated, info

    def render(self) -> tuple[Any, ...] | None:
        """A frame of every environment, as the scalar environment's ``render``."""
        checks.begun(bool(self._begun.any()), self.closed, "render")
        if self.render_mode is None:
            return None
        return tuple(self._frame(row) for row in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Release the renderer."""
        self.core.close()

    @property  # type: ignore[misc]
    def np_random(self) -> Any:
        """One generator an environment."""
        return tuple(self.simulations.generators)

    @property
    def np_random_seed(self) -> Any:
        """The seed of each; None where it was never given one."""
        return tuple(self._seeds)

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """As the scalar environment's, over leading batch axes: what HER relies on."""
        return self.core.compute_reward(achieved_goal, desired_goal, info)

    # Parts ----------------------------------------------------------------------------------------------------------

    def _goals(self, goal: Any) -> Array:
        size = self.simulations.goal.shape[1]
        asked = np.asarray(goal) if not isinstance(goal, (str, bytes)) else np.asarray(None)
        if asked.shape == (self.num_envs, size):
            return np.array([self.core.checked_goal(one) for one in asked])
        if asked.ndim > 1:
            raise ValueError(f"goal has shape {asked.shape}: give ({size},), or ({self.num_envs}, {size}) for one each")
        return np.broadcast_to(self.core.checked_goal(goal), (self.num_envs, size))

    def _check_open(self) -> None:
        if self.closed:
            raise checks.closed()

    def _check_begun(self) -> None:
        checks.begun(self._ready, self.closed, "step")
        if self._over and self.autoreset_mode == AutoresetMode.DISABLED:
            rows = np.flatnonzero(self._ended).tolist()
            raise error.ResetNeeded(
                f"the episodes of environments {rows} have ended and autoreset_mode is 'Disabled': reset them with "
                "reset(options={'reset_mask': ...})"
            )

    def _restart(self, rows: Rows) -> None:
        self.simulations.restart(rows)
        self._episodes.begin(rows)
        self._begun[rows], self._ended[rows] = True, False
        self._ready, self._over = bool(self._begun.all()), bool(self._ended.any())

    def _advance(self, command: Array, refused: Mask | None, rows: Rows | None) -> Rows:
        diverged = self.simulations.advance(command, refused, rows)
        if refused is not None and refused.any():
            self._warn(f"actions of environments {np.flatnonzero(refused).tolist()} are not finite: they stand still")
        if len(diverged):
            self._diverged[diverged] += 1
            self._warn(f"simulations {diverged.tolist()} have diverged: their episodes are truncated")
        return diverged

    @staticmethod
    def _warn(words: str) -> None:
        warnings.warn(words, RuntimeWarning, stacklevel=4)

    def _seen(self) -> tuple[dict[str, Array], dict[str, Any]]:
        """Observations in the goal form, and what ``info`` says."""
        state, goal = self.simulations.state, self.simulations.goal
        observation = self.core.observed(state, goal)
        return observation, self.core.described(state, observation["achieved_goal"], goal)

    def _shown(self, observation: dict[str, Array]) -> Any:
        return observation if self._flat is None else self._flat.flattened(observation)

    def _at_end(self, observation: dict[str, Array], facts: dict[str, Any]) -> tuple[dict[str, Array], dict[str, Any]]:
        """Observation and ``info`` of this step; where it is asked for, those that ended begin their next episodes."""
        info: dict[str, Any] = {}
        if self._over:
            ended = self._ended.copy()
            if self._statistics:
                info["episode"], info["_episode"] = self._episodes.statistics(ended), ended
            if self.autoreset_mode == AutoresetMode.SAME_STEP:
                info["final_obs"], info["_final_obs"] = report.one_by_one(self._shown(observation), ended), ended
                info["final_info"], info["_final_info"] = report.of_some(facts, ended), ended
                self._restart(np.flatnonzero(ended))
                observation, facts = self._seen()
        info.update(report.of_all(facts, self._everyone))
        info["diverged"], info["_diverged"] = self._diverged.copy(), self._everyone
        return observation, info

    def _flags(self, value: Any) -> Mask:
        if isinstance(value, bool):
            return np.ones(self.num_envs, dtype=bool) if value else np.zeros(self.num_envs, dtype=bool)
        return np.array(value, dtype=bool)

    def _frame(self, row: int) -> Any:
        core, batch = self.core, self.simulations.batch
        batch.get_model(row, core.model)
        batch.get_data(row, core.data)
        mujoco.mj_forward(core.model, core.data)
        return core.show(self.simulations.goal[row])


def _everyone(count: int) -> Mask:
    """A mask of all, read-only: ``info`` hands it out."""
    mask = np.ones(count, dtype=bool)
    mask.flags.writeable = False
    return mask
