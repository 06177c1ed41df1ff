"""What training costs on one thread, choice by choice, and what it comes to.

    OMP_NUM_THREADS=1 taskset -c 0 python benchmarks/training_speed.py [--rounds N] [--only WHAT]

Updates: stable-baselines3's own and ours, Adam fused or not, batches of 100 and 256; each on a full buffer of random
transitions. Environment steps: collected with the policy and its exploration noise and stored, without updates, for
numbers of environments and both servos. A step of training takes the time of an environment step and of `ratio`
updates; measured whole for some ratios, as a check. Choices are measured in turns, in processor time, which other
programs disturb less than the clock; medians over rounds are told.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import torch
from machine import save

from tiago_mj.learn.build import make_model
from tiago_mj.learn.environments import make_env
from tiago_mj.learn.settings import Settings
from tiago_mj.learn.zoo_form import read_hyperparameters

ENV = "tiago_mj/GripperTactile-v0"
WHAT = ("update", "environment step", "training step")
RATIOS = (1.0, 0.5, 0.25, 0.125)
Timer = Callable[[], float]


def settings(envs: int, servo: str = "ideal", batch: int = 100, ratio: float | None = None) -> Settings:
    given = {**read_hyperparameters("td3", ENV), "n_envs": envs, "batch_size": batch, "learning_starts": 0}
    options = {**given["env_kwargs"], "servo": servo}
    return Settings(ENV, "td3", 50_000, options, None, given, updates_per_step=ratio)


def updating(batch: int, fast: bool, fused: bool, *, updates: int) -> Timer:
    """A function that times one update [s], on a full buffer."""
    chosen = settings(1, batch=batch)
    model = make_model(chosen, make_env(chosen, 1), 0, fast=fast, fused=fused)
    model.gradient_steps = 0
    model.learn(300, log_interval=None)
    model.train(10, batch)
    return timed_updates(model, batch, updates=updates)


def timed_updates(model: Any, batch: int, *, updates: int) -> Timer:
    """A function that times one update of a model [s], whose buffer is filled with random transitions."""
    buffer, rng = model.replay_buffer, np.random.default_rng(0)
    for values in (buffer.observations, buffer.next_observations, buffer.actions, buffer.rewards):
        values[:] = rng.uniform(-1, 1, values.shape)
    buffer.full = True

    def once() -> float:
        begin = time.process_time()
        model.train(updates, batch)
        return (time.process_time() - begin) / updates

    return once


def stepping(envs: int, servo: str = "ideal", ratio: float | None = None, *, steps: int) -> Timer:
    """A function that times one environment step of training [s]; without updates unless there is a ratio."""
    chosen = settings(envs, servo, ratio=ratio)
    model = make_model(chosen, make_env(chosen, envs), 0)
    if ratio is None:
        model.gradient_steps = 0
    model.learn(300, log_interval=None)

    def once() -> float:
        begin, before = time.process_time(), model.num_timesteps
        model.learn(steps, log_interval=None, reset_num_timesteps=False)
        return (time.process_time() - begin) / (model.num_timesteps - before)

    return once


def choices(updates: int, steps: int) -> list[tuple[dict[str, Any], Callable[[], Timer]]]:
    """What is timed, and what makes its timer."""
    found: list[tuple[dict[str, Any], Callable[[], Timer]]] = []
    for batch in (100, 256):
        for fast, fused in ((False, False), (False, True), (True, False), (True, True)):
            said = {"what": WHAT[0], "updates": "ours" if fast else "sb3", "adam": "fused" if fused else "plain"}
            found.append(({**said, "batch": batch}, partial(updating, batch, fast, fused, updates=updates)))
    for servo in ("ideal", "pal"):
        for envs in (1, 4, 10, 30):
            said = {"what": WHAT[1], "servo": servo, "envs": envs}
            found.append((said, partial(stepping, envs, servo, steps=4 * steps)))
    for envs in (1, 10):
        for ratio in RATIOS:
            said = {"what": WHAT[2], "servo": "ideal", "envs": envs, "updates_per_step": ratio}
            found.append((said, partial(stepping, envs, ratio=ratio, steps=steps)))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", choices=WHAT)
    parser.add_argument("--updates", type=int, default=150, help="in one sample")
    parser.add_argument("--steps", type=int, default=600, help="in one sample")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    chosen = [row for row in choices(arguments.updates, arguments.steps) if arguments.only in (None, row[0]["what"])]
    timers = [(said, make(), []) for said, make in chosen]
    for _ in range(arguments.rounds):
        for _, once, samples in timers:
            samples.append(once())
    rows = []
    for said, _, samples in timers:
        middle = float(np.median(samples))
        low, high = 1e3 * min(samples), 1e3 * max(samples)
        row = {**said, "ms": round(1e3 * middle, 4), "ms_range": [round(low, 4), round(high, 4)]}
        rows.append({**row, "per_second": round(1 / middle, 1)})
        told = ", ".join(f"{key} {value}" for key, value in said.items() if key != "what")
        print(f"{said['what']:18}{told:52}{1e3 * middle:9.3f} ms  ({low:.3f} to {high:.3f})  {1 / middle:8.1f} /s")
    print("saved", save("training_speed", {"threads": 1, "torch": torch.__version__, "rows": rows}).name)


if __name__ == "__main__":
    main()
