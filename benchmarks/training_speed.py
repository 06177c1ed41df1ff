"""What training costs on one thread, choice by choice, and what it comes to.

    OMP_NUM_THREADS=1 taskset -c 0 python benchmarks/training_speed.py [--rounds N]

Updates: stable-baselines3's own and ours, Adam fused or not, batches of 100 and 256; each on a full buffer of random
transitions. Environment steps: collected with the policy and its exploration noise and stored, without updates, for
numbers of environments and both servos. A step of training takes the time of an environment step and of `ratio`
updates; measured whole for some ratios, as a check. Choices are measured in turns; medians over rounds are told.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from machine import save

from tiago_mj.learn.build import make_env, make_model
from tiago_mj.learn.settings import Settings
from tiago_mj.learn.zoo_form import read_hyperparameters

ENV = "tiago_mj/GripperTactile-v0"
UPDATES, COLLECTED = 150, 2400
RATIOS = (1.0, 0.5, 0.25, 0.125)


def settings(envs: int, servo: str = "ideal", batch: int = 100, ratio: float | None = None) -> Settings:
    given = {**read_hyperparameters("td3", ENV), "n_envs": envs, "batch_size": batch, "learning_starts": 0}
    return Settings(ENV, "td3", 50_000, {**given["env_kwargs"], "servo": servo}, None, given, updates_per_step=ratio)


def updating(batch: int, fast: bool, fused: bool) -> Callable[[], float]:
    """A function that times one update [s], in the middle of a training."""
    chosen = settings(1, batch=batch)
    model = make_model(chosen, make_env(chosen, 1), 0, fast=fast, fused=fused)
    model.learn(300, log_interval=None)
    buffer, rng = model.replay_buffer, np.random.default_rng(0)
    for values in (buffer.observations, buffer.next_observations, buffer.actions, buffer.rewards):
        values[:] = rng.uniform(-1, 1, values.shape)
    buffer.full = True

    def once() -> float:
        begin = time.perf_counter()
        model.train(UPDATES, batch)
        return (time.perf_counter() - begin) / UPDATES

    return once


def collecting(envs: int, servo: str) -> Callable[[], float]:
    """A function that times one environment step of training without updates [s]."""
    chosen = settings(envs, servo)
    model = make_model(chosen, make_env(chosen, envs), 0)
    model.gradient_steps = 0
    model.learn(COLLECTED // 4, log_interval=None)

    def once() -> float:
        begin, before = time.perf_counter(), model.num_timesteps
        model.learn(COLLECTED, log_interval=None, reset_num_timesteps=False)
        return (time.perf_counter() - begin) / (model.num_timesteps - before)

    return once


def training(envs: int, ratio: float) -> Callable[[], float]:
    """A function that times one environment step of training with its share of updates [s]."""
    chosen = settings(envs, ratio=ratio)
    model = make_model(chosen, make_env(chosen, envs), 0)
    model.learn(600, log_interval=None)

    def once() -> float:
        begin, before = time.perf_counter(), model.num_timesteps
        model.learn(600, log_interval=None, reset_num_timesteps=False)
        return (time.perf_counter() - begin) / (model.num_timesteps - before)

    return once


def choices() -> list[tuple[dict[str, Any], Callable[[], float]]]:
    found: list[tuple[dict[str, Any], Callable[[], float]]] = []
    for batch in (100, 256):
        for fast, fused in ((False, False), (False, True), (True, False), (True, True)):
            said = {"what": "update", "updates": "ours" if fast else "sb3", "adam": "fused" if fused else "plain"}
            found.append(({**said, "batch": batch}, updating(batch, fast, fused)))
    for servo in ("ideal", "pal"):
        for envs in (1, 4, 10, 30):
            found.append(({"what": "environment step", "servo": servo, "envs": envs}, collecting(envs, servo)))
    for envs in (1, 10):
        for ratio in RATIOS:
            said = {"what": "training step", "servo": "ideal", "envs": envs, "updates_per_step": ratio}
            found.append((said, training(envs, ratio)))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    listed = choices()
    samples: list[list[float]] = [[] for _ in listed]
    for _ in range(arguments.rounds):
        for row, (_, once) in zip(samples, listed, strict=True):
            row.append(once())
    rows = []
    for (said, _), taken in zip(listed, samples, strict=True):
        middle = float(np.median(taken))
        low, high = 1e3 * min(taken), 1e3 * max(taken)
        row = {**said, "ms": round(1e3 * middle, 4), "ms_range": [round(low, 4), round(high, 4)]}
        rows.append({**row, "per_second": round(1 / middle, 1)})
        told = ", ".join(f"{key} {value}" for key, value in said.items() if key != "what")
        print(f"{said['what']:18}{told:52}{1e3 * middle:9.3f} ms  ({low:.3f} to {high:.3f})  {1 / middle:8.1f} /s")
    print("saved", save("training_speed", {"threads": 1, "torch": torch.__version__, "rows": rows}).name)


if __name__ == "__main__":
    main()
