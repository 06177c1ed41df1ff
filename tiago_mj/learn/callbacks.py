"""Callbacks of a training: log episodes, keep the best policy, evaluate policies, save states."""

from __future__ import annotations

import os
import time
import warnings
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback

from tiago_mj.learn import checkpoint, curves
from tiago_mj.learn.agent_file import Agent, from_arrays
from tiago_mj.learn.evaluation import Evaluator
from tiago_mj.learn.export import agent_of
from tiago_mj.learn.progress import report

#: The best policy is that with the best mean return of this many training episodes (paper, section IV).
BEST_OF: Final = 20
#: Seconds between reports of progress.
BEAT: Final = 1.0


#: Of each evaluation.
EVALUATED: Final = ("steps", "mean_return", "sd_return", "success_rate")


class Best:
    """Best policy so far by mean return.

    Attributes:
        agent: None as long as there is none.
        mean, steps: its mean return, and the environment steps of its training.
    """

    def __init__(self, origin: Mapping[str, Any], name: str) -> None:
        self._origin, self._prefix = dict(origin), f"{name}_"
        self.agent: Agent | None = None
        self.mean, self.steps = -np.inf, 0

    def offer(self, model: Any, mean: float) -> None:
        """Take a model's present policy if it is better."""
        if mean > self.mean:
            self.mean, self.steps = mean, model.num_timesteps
            self.agent = agent_of(model, {**self._origin, "steps": self.steps})

    def state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """State for a checkpoint: JSON and arrays."""
        if self.agent is None:
            return {}, {}
        data = {"mean": self.mean, "steps": self.steps, "header": self.agent.header()}
        return data, {f"{self._prefix}{key}": value for key, value in self.agent.arrays().items()}

    def restore(self, data: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore the state of a checkpoint."""
        if data.get("header") is not None:
            parts = {k.removeprefix(self._prefix): v for k, v in arrays.items() if k.startswith(self._prefix)}
            self.agent = from_arrays(data["header"], parts)
            self.mean, self.steps = float(data["mean"]), int(data["steps"])
            if not np.isfinite(self.mean):
                raise ValueError(f"the best mean return is {self.mean}")


class Episodes(BaseCallback):  # type: ignore[misc]
    """Logs training episodes and keeps the best policy: that with the best mean return of the last 20 of them.

    Args:
        origin: where agents come from, kept with them.
    """

    def __init__(self, origin: Mapping[str, Any]) -> None:
        super().__init__()
        self.log: list[tuple[int, float, bool]] = []
        self.best = Best(origin, "best")
        self._last: deque[float] = deque(maxlen=BEST_OF)
        #: Episodes that the policy plays from their beginning: one that a controller began says nothing of it.
        self._own: NDArray[np.bool_] | None = None

    def begin(self) -> None:
        """New episodes of all environments begin."""
        self._own = None

    def _on_step(self) -> bool:
        dones, acts = self.locals["dones"], getattr(self.model, "acts", True)
        if self._own is None:
            self._own = np.full(len(dones), acts)
        for k in np.flatnonzero(dones).tolist():
            if self._own[k]:
                info = self.locals["infos"][k]
                total = float(info["episode"]["r"])
                self._last.append(total)
                self.log.append((self.num_timesteps, total, bool(info["is_success"])))
            self._own[k] = acts
        if not dones.any():
            return True
        if len(self._last) == BEST_OF:
            self.best.offer(self.model, float(np.mean(self._last)))
        return True

    @property
    def recent(self) -> float | None:
        """Mean return of the last 20 episodes, or of those there are."""
        return float(np.mean(self._last)) if self._last else None

    @property
    def success_rate(self) -> float | None:
        """Share of successes among the last 100 episodes."""
        return float(np.mean([success for *_, success in self.log[-100:]])) if self.log else None

    def state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """State for a checkpoint: JSON and arrays."""
        data, arrays = self.best.state()
        return data, {**arrays, "log": np.array(self.log, dtype=np.float64).reshape(-1, 3)}

    def restore(self, data: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore the state of a checkpoint."""
        if arrays["log"].ndim != 2 or not np.isfinite(arrays["log"]).all():
            raise ValueError("the log of its episodes is none")
        self.log = [(int(steps), float(total), bool(success)) for steps, total, success in arrays["log"]]
        self._last.extend(total for _, total, _ in self.log[-BEST_OF:])
        self.best.restore(data, arrays)


class Evaluations(BaseCallback):  # type: ignore[misc]
    """Evaluates the policy, without exploration and on the same episodes every time, between rollouts; keeps the best.

    Args:
        evaluator: plays the episodes.
        every: environment steps between evaluations.
        origin: where agents come from, kept with them.
    """

    def __init__(self, evaluator: Evaluator, every: int, origin: Mapping[str, Any]) -> None:
        super().__init__()
        self._evaluator, self._every = evaluator, every
        self.log: list[dict[str, float]] = []
        self.best = Best(origin, "evaluated")

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        last = self.log[-1]["steps"] if self.log else 0
        if self.model.num_timesteps // self._every > last // self._every:
            self.evaluate()

    def _on_training_end(self) -> None:
        if not self.log or self.log[-1]["steps"] != self.model.num_timesteps:
            self.evaluate()

    def evaluate(self) -> None:
        """Add an evaluation of the present policy to the log."""
        self.log.append({"steps": self.model.num_timesteps, **self._evaluator(agent_of(self.model))})
        self.best.offer(self.model, self.log[-1]["mean_return"])


class Checkpoints(BaseCallback):  # type: ignore[misc]
    """Saves the whole state every so many steps, and begins the next episodes from generators that it knows.

    The environments' own states are not saved: at a checkpoint all of them begin new episodes, seeded by the training's
    seed and the number of steps. A run that goes on from the file therefore does what the run that wrote it did. It
    waits for the end of an episode of all of them, at most one episode's length; then what has begun is broken off.

    Args:
        folder: of the seed.
        seed: of the training.
        every: environment steps between checkpoints.
        episode_steps: time limit of an episode.
        episodes, evaluations: what is saved along, and written as curves.
    """

    def __init__(
        self, folder: Path, seed: int, every: int, episode_steps: int, episodes: Episodes, evaluations: Evaluations
    ) -> None:
        super().__init__()
        self._folder, self._seed, self._every, self._patience = folder, seed, every, episode_steps
        self._episodes, self._evaluations = episodes, evaluations
        self._saved_at = 0

    def restore(self, found: checkpoint.Checkpoint) -> None:
        """Restore the state of a checkpoint."""
        self._saved_at = found.steps
        self._episodes.restore(found.callbacks["episodes"], found.arrays)
        log = [{name: float(entry[name]) for name in EVALUATED} for entry in found.callbacks["evaluations"]]
        if not np.isfinite([list(entry.values()) for entry in log]).all() or (found.finished and not log):
            raise ValueError("its evaluations are none")
        self._evaluations.log = [{**entry, "steps": int(entry["steps"])} for entry in log]
        self._evaluations.best.restore(found.callbacks.get("evaluated", {}), found.arrays)

    def _on_training_start(self) -> None:
        checkpoint.restore_generators(self.model)

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        steps = self.model.num_timesteps
        overdue = steps - (self._saved_at // self._every + 1) * self._every
        if overdue < 0:
            return
        ended = self.locals.get("dones")
        if (ended is None or not np.all(ended)) and overdue < self._patience * self.model.n_envs:
            return
        self.save(finished=False)
        begin_episodes(self.model, self._seed)
        self._episodes.begin()

    def save(self, *, finished: bool) -> None:
        """Write the curves, the best policies so far, and last the checkpoint.

        Who is killed in between goes on from the checkpoint before, and writes the same again.
        """
        data, arrays = self._episodes.state()
        evaluated, more = self._evaluations.best.state()
        callbacks = {"episodes": data, "evaluations": self._evaluations.log, "evaluated": evaluated}
        if not finished:
            _break_off(self.model)
        curves.write_seed(self._folder, self._episodes.log, self._evaluations.log)
        for name, best in (("best", self._episodes.best), ("evaluated", self._evaluations.best)):
            if best.agent is not None:
                best.agent.save(self._folder / f"{name}.npz")
        path = self._folder / checkpoint.FILE
        checkpoint.write(path, self.model, callbacks=callbacks, arrays=arrays | more, finished=finished)
        self._saved_at = self.model.num_timesteps


class Progress(BaseCallback):  # type: ignore[misc]
    """Reports the progress of a training to its parent process, and stops when that has ended.

    Args:
        folder: of the seed.
        total: environment steps.
        episodes: for the returns.
        alive: whether whoever started the training is there; None: it is this process.
    """

    def __init__(self, folder: Path, total: int, episodes: Episodes, alive: Callable[[], bool] | None) -> None:
        super().__init__()
        self._folder, self._total, self._episodes, self._alive = folder, total, episodes, alive
        self._next = 0.0

    def _on_step(self) -> bool:
        now = time.monotonic()
        if now < self._next:
            return True
        self._next = now + BEAT
        if self._alive is not None and not self._alive():
            os._exit(1)  # a worker that only returned would wait for its next task for ever
        report(
            self._folder,
            {
                "steps": self.num_timesteps,
                "total": self._total,
                "mean_return": self._episodes.recent,
                "success_rate": self._episodes.success_rate,
                "process": os.getpid(),
            },
        )
        return True


def _break_off(model: Any) -> None:
    """Mark the unfinished episodes in a hindsight replay buffer as finished."""
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None and hasattr(buffer, "truncate_last_trajectory"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # stable-baselines3 says what is wanted here
            buffer.truncate_last_trajectory()


def begin_episodes(model: Any, seed: int) -> None:
    """Begin new episodes of a model's environments, seeded by the training's seed and its steps so far."""
    env = model.env
    numbers = np.random.SeedSequence([seed, model.num_timesteps]).generate_state(1)
    env.seed(int(numbers[0]))
    model._last_obs = env.reset()
    model._last_episode_starts = np.ones(env.num_envs, dtype=bool)
    if (normalised := model.get_vec_normalize_env()) is not None:
        model._last_original_obs = normalised.get_original_obs()
    if getattr(model, "action_noise", None) is not None:
        model.action_noise.reset()
    if hasattr(model, "begin_episodes"):
        model.begin_episodes()
