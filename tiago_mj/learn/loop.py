"""Training of one seed, from its settings to its agents; started, or resumed from a checkpoint."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tiago_mj.io import atomic, held
from tiago_mj.learn.settings import Settings, provenance

BEST, LAST, MODEL = "best.npz", "last.npz", "model.zip"


@dataclass(frozen=True)
class Task:
    """A seed to be trained, and where.

    Attributes:
        settings: of the training.
        seed: of everything that is drawn.
        folder: of this seed.
        tensorboard: whether to log for it.
        starter: process that started this; the training stops when it is gone. None: nothing stops it.
        patience: seconds to wait for another process that is training this seed; None: for one that is about to end.
    """

    settings: Settings
    seed: int
    folder: str
    tensorboard: bool = False
    starter: int | None = None
    patience: float | None = None


def train_seed(task: Task) -> dict[str, Any]:
    """Train a seed to its end, on one thread.

    Returns:
        ``seed``, ``steps``, ``seconds`` of this session, ``processor_seconds`` that it took of all cores, and
        ``steps_per_second`` in it (None where it had nothing to do), ``best_mean`` (of 20 training episodes) at
        ``best_steps``, and the last evaluation's ``mean_return``, ``sd_return``, ``success_rate``.

    Raises:
        ValueError: the checkpoint is damaged, or another process is training in the folder; one line.
    """
    import torch

    torch.set_num_threads(1)
    folder = Path(task.folder)
    with held.alone(folder, "training", task.patience):
        return _train(task, folder)


def _train(task: Task, folder: Path) -> dict[str, Any]:
    from tiago_mj.learn import checkpoint
    from tiago_mj.learn.build import demonstrate, make_model
    from tiago_mj.learn.callbacks import Checkpoints, Episodes, Evaluations, Progress, begin_episodes
    from tiago_mj.learn.environments import make_env
    from tiago_mj.learn.evaluation import Evaluator
    from tiago_mj.learn.export import agent_of
    from tiago_mj.learn.noise import Fall

    settings = task.settings
    env = make_env(settings, settings.hyperparameters["n_envs"])
    examiner = make_env(settings, settings.evaluation_episodes)
    model = make_model(settings, env, task.seed)
    model.set_logger(_logger(folder, task.tensorboard))
    origin = origin_of(settings, task.seed)
    episodes = Episodes(origin)
    evaluations = Evaluations(Evaluator(examiner), settings.evaluate_every, origin)
    saving = Checkpoints(folder, task.seed, settings.checkpoint_every, settings.episode_steps, episodes, evaluations)
    starter = task.starter
    alive = None if starter is None or starter == os.getpid() else _parent_is_there()
    finished = False
    if (path := folder / checkpoint.FILE).exists():
        found = checkpoint.read(path, model)
        with checkpoint.readable(path):
            saving.restore(found)
        finished = found.finished
        if not finished:
            begin_episodes(model, task.seed)
    begun, busy, before = time.monotonic(), time.process_time(), model.num_timesteps
    if not finished:
        demonstrate(model, settings, task.seed, stored=before > 0)
        progress = Progress(folder, settings.steps, episodes, alive)
        model.learn(
            settings.steps - before,
            callback=[episodes, evaluations, saving, Fall(settings.steps), progress],
            reset_num_timesteps=before == 0,
            log_interval=10,
        )
        last = agent_of(model, {**origin, "steps": model.num_timesteps})
        last.save(folder / LAST)
        if episodes.best.agent is None:  # fewer than 20 episodes
            last.save(folder / BEST)
        _save_model(model, folder / MODEL)
        saving.save(finished=True)  # last: what it calls finished is all there
    seconds = time.monotonic() - begun
    env.close()
    examiner.close()
    steps = model.num_timesteps
    return {
        "seed": task.seed,
        "steps": steps,
        "seconds": None if finished else round(seconds, 1),
        "processor_seconds": None if finished else round(time.process_time() - busy, 1),
        "steps_per_second": None if finished else round((steps - before) / seconds, 1),
        "best_mean": None if episodes.best.agent is None else round(episodes.best.mean, 4),
        "best_steps": steps if episodes.best.agent is None else episodes.best.steps,
        **{key: round(value, 4) for key, value in evaluations.log[-1].items() if key != "steps"},
    }


def origin_of(settings: Settings, seed: int) -> dict[str, Any]:
    """Origin of an agent, as its file states it."""
    return {
        "env": settings.env,
        "env_options": dict(settings.env_options),
        "effects": settings.effects,
        **({} if settings.randomise is None else {"randomise": settings.randomise}),
        "algo": settings.algo,
        "seed": seed,
        "made_by": provenance(),
    }


def _logger(folder: Path, tensorboard: bool) -> Any:
    from stable_baselines3.common.logger import Logger

    if not tensorboard:
        return Logger(folder=None, output_formats=[])
    from stable_baselines3.common.logger import TensorBoardOutputFormat

    return Logger(folder=None, output_formats=[TensorBoardOutputFormat(str(folder / "tensorboard"))])


def _save_model(model: Any, path: Path) -> None:
    with atomic.replacing(path) as temporary, temporary.open("wb") as file:
        model.save(file, exclude=["replay_buffer_class", "_restored", "expert"])


def _parent_is_there() -> Any:
    """Whether the process that started this one still is its parent."""
    first = os.getppid()
    return lambda: os.getppid() == first
