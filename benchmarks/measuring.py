"""Measurement of speed: loads, rates, memory, and samples in the format of ``pyperf``.

A shared machine changes its speed from second to second, so what is compared is measured in turns: each round has one
sample of everything, ratios are taken within a round, and medians over the rounds are told.
"""

from __future__ import annotations

import gc
import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from machine import RESULTS

LOADS = ("random", "grasp")


def actions(load: str, steps: int, joints: int, seed: int) -> np.ndarray:
    """One episode's actions, (steps, joints): ``random``, or ``grasp``: the fingers close in the first half and hold
    what there is to hold in the second."""
    if load == "random":
        return np.random.default_rng(seed).uniform(-1, 1, (steps, joints)).astype(np.float32)
    out = np.zeros((steps, joints), dtype=np.float32)
    out[: steps // 2, -2:] = -1.0
    return out


def resident_mb() -> float:
    """Resident memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    import resource

    return pages * resource.getpagesize() / 1e6


def seconds(call: Callable[[], Any]) -> float:
    """Duration of one call [s], without the garbage of the one before."""
    gc.collect()
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


def episode(env: Any, load: str, seed: int) -> tuple[float, float, int]:
    """Seconds of a reset, of the steps after it, and their number; the first reset is seeded."""
    limit = env.spec.max_episode_steps
    given = actions(load, limit, env.action_space.shape[0], seed)
    begin = time.perf_counter()
    env.reset(seed=None if seed else 0)
    middle = time.perf_counter()
    for action in given:
        env.step(action)
    return middle - begin, time.perf_counter() - middle, limit


def raw_seconds(env: Any, load: str, seed: int) -> tuple[float, int]:
    """Seconds that MuJoCo alone takes for an episode's physics, stepped in C on one thread, and control steps in it."""
    core = getattr(env.unwrapped, "core", env.unwrapped)
    env.reset(seed=seed)
    limit = env.spec.max_episode_steps
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    start = np.empty((1, mujoco.mj_stateSize(core.model, kind)))
    mujoco.mj_getState(core.model, core.data, start[0], kind)
    controls = np.zeros((limit, core.model.nu))
    for k, action in enumerate(actions(load, limit, env.action_space.shape[0], seed)):
        env.step(action)
        controls[k] = core.data.ctrl
    from mujoco import rollout

    every = np.repeat(controls, core.n_substeps, axis=0)[None]
    data = mujoco.MjData(core.model)
    begin = time.perf_counter()
    rollout.rollout(core.model, data, start, every)
    return time.perf_counter() - begin, limit


def vector_seconds(envs: Any, load: str, seed: int) -> tuple[float, int]:
    """Seconds of an episode of all environments, the autoreset at its end included, and steps of all together."""
    limit = envs.spec.max_episode_steps
    given = actions(load, limit, envs.single_action_space.shape[0], seed)
    every = [np.repeat(action[None], envs.num_envs, axis=0) for action in given]
    if load == "random":
        rng = np.random.default_rng(seed)
        every = [rng.uniform(-1, 1, one.shape).astype(np.float32) for one in every]
    envs.reset(seed=seed)
    begin = time.perf_counter()
    for action in every:
        envs.step(action)
    return time.perf_counter() - begin, limit * envs.num_envs


def middle(values: Sequence[float]) -> float:
    return float(statistics.median(values))


def in_a_process(script: str, arguments: Sequence[str], python: str = sys.executable) -> Any:
    """What a script prints on its last line, as JSON; it runs in a process of its own."""
    done = subprocess.run([python, script, *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{script} {' '.join(arguments)} failed:\n{done.stderr[-2000:]}")
    return json.loads(done.stdout.splitlines()[-1])


def save_samples(name: str, samples: Mapping[str, Sequence[float]]) -> Path:
    """Write seconds per step to ``results/NAME.pyperf.json``: ``python -m pyperf stats`` and ``compare_to`` read it."""
    import pyperf

    suite = []
    for key, values in samples.items():
        metadata = {"name": key, "unit": "second"}
        suite.append(pyperf.Benchmark([pyperf.Run([v], metadata=metadata, collect_metadata=False) for v in values]))
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{name}.pyperf.json"
    pyperf.BenchmarkSuite(suite).dump(str(path), replace=True)
    return path
