"""Duration of a training, estimated before it begins."""

from __future__ import annotations

import os
import time
from typing import Any, Final

from tiago_mj.io import progress

#: Seconds that are measured, and at most waited for in all.
MEASURED: Final = 2.0
PATIENCE: Final = 10.0
#: Steps after which a trial run updates its networks, as training does from its own number on.
WARM_UP: Final = 64
#: Steps of every environment in a round of the trial, at most.
ROUND: Final = 4
#: Trainings of fewer environment steps in all are not worth measuring.
SHORT: Final = 50_000


def steps_per_second(model: Any) -> float:
    """Environment steps a second of a model as it trains, updates included; the model is used up."""
    import torch
    from stable_baselines3.common.callbacks import BaseCallback

    class Watch(BaseCallback):  # type: ignore[misc]
        """Measures whole rounds of collecting and updating, from the first update on, and stops after a while."""

        def __init__(self) -> None:
            super().__init__()
            self.began, self.before, self.rate = time.monotonic(), 0, 0.0
            self.since: float | None = None

        def _on_rollout_start(self) -> None:
            now = time.monotonic()
            if self.since is not None:
                self.rate = (self.num_timesteps - self.before) / max(now - self.since, 1e-9)
            elif self.model._n_updates > 0:
                self.since, self.before = now, self.num_timesteps

        def _on_step(self) -> bool:
            now = time.monotonic()
            if now - self.began >= PATIENCE and not self.rate:
                self.rate = self.num_timesteps / (now - self.began)
            return now - self.began < PATIENCE and not (self.rate and now - (self.since or now) >= MEASURED)

    threads, watch = torch.get_num_threads(), Watch()
    torch.set_num_threads(1)  # as each seed trains
    try:
        if hasattr(model, "learning_starts") and not hasattr(model.replay_buffer, "ep_length"):
            model.learning_starts = WARM_UP  # hindsight replay cannot begin before an episode is over
        if hasattr(model, "train_freq"):
            _shorten(model)
        model.learn(10**9, callback=watch)
    finally:
        torch.set_num_threads(threads)
    return watch.rate


def _shorten(model: Any) -> None:
    """Collect and update in smaller rounds of the same ratio, so that some fit into the time that is measured."""
    from stable_baselines3.common.type_aliases import TrainFreq

    model._convert_train_freq()
    count, unit = model.train_freq
    updates = model.gradient_steps  # below 0: as many as there were steps
    if unit.value == "step" and count > ROUND and updates:
        few = ROUND if updates < 0 else min(count, max(ROUND, round(count / updates)))
        model.train_freq = TrainFreq(few, unit)
        model.gradient_steps = updates if updates < 0 else round(updates * few / count)


def said(rate: float, steps: int, seeds: int, jobs: int, left: int) -> str:
    """The estimate as one line.

    Args:
        rate: environment steps a second of one seed alone.
        steps, seeds: of the training.
        jobs: processes at once.
        left: steps of all seeds that are still to be done.
    """
    at_once = max(min(jobs, seeds, os.cpu_count() or 1), 1)
    of = f"{seeds} seeds of {steps} steps" if seeds > 1 else f"{steps} steps"
    many = f", {at_once} at a time" if seeds > 1 else ""
    return (
        f"train: {of}{many}: about {progress.seconds(left / (rate * at_once))} "
        f"({rate:.0f} steps/s a seed, measured; evaluations come on top)"
    )
