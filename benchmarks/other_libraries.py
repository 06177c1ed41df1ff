"""How fast the kept libraries of the same algorithms update and learn, beside ours: sb3-contrib and sbx.

    pip install sb3-contrib sbx-rl
    OMP_NUM_THREADS=1 taskset -c 0 python benchmarks/other_libraries.py [updates|reach] [--seeds 3]

`updates`: one update on a full buffer of random transitions, processor time, choices in turns, medians of rounds; TD3
of all, and what the libraries have beyond it. `reach`: TIAGoReach with hindsight replay and the hyperparameters that
rl-zoo3 has for FetchReach with TQC (hyperparams/tqc.yml at 22e3ff2: networks of 64-64, batch 256, gamma 0.95,
normalised), but 40 000 steps and a learning rate that falls to 0, as our own recipe has; eight environments and an
update a step. Success of 200 episodes that no training used after every 5000 steps, and the processor time until then,
evaluations apart.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import numpy as np
import sb3_contrib
import sbx
import torch
from machine import RESULTS, machine, save
from scripted_experts import wilson
from stable_baselines3 import HerReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecNormalize
from training_speed import ENV, settings, timed_updates, updating

from tiago_mj.learn.environments import make_env
from tiago_mj.vector.sb3 import make_sb3

NAME = "other_libraries"
KINDS = {
    "sb3-contrib TQC": sb3_contrib.TQC,
    "sb3-contrib CrossQ": sb3_contrib.CrossQ,
    "sbx TD3": sbx.TD3,
    "sbx TQC": sbx.TQC,
    "sbx CrossQ": sbx.CrossQ,
}
PARTS = ("updates", "reach")
LIBRARIES = ("stable-baselines3", "sb3-contrib", "sbx-rl", "jax", "torch")
#: sb3-contrib's CrossQ takes no observations in goal form, and an update of its TQC several times as long as sbx's.
REACHING = ("sbx TD3", "sbx TQC", "sbx CrossQ")
NETWORKS, BATCH = [400, 300], 100
REACH, STEPS, EVERY, EPISODES = "tiago_mj/TIAGoReach-v0", 40_000, 5_000, 200
#: Of the evaluations: no training uses these.
FIRST_SEED = 940_000


def library_updating(kind: Any, *, updates: int) -> Callable[[], float]:
    """A function that times one update of a library's algorithm [s], with the paper's networks and batch."""
    env = make_env(settings(1), 1)
    common = {"policy_kwargs": {"net_arch": NETWORKS}, "batch_size": BATCH, "buffer_size": 50_000, "device": "cpu"}
    model = kind("MlpPolicy", env, learning_rate=1e-3, learning_starts=0, gradient_steps=0, seed=0, **common)
    model.learn(300, log_interval=None)
    once = timed_updates(model, BATCH, updates=updates)
    once()  # compiles
    return once


def updates(rounds: int, count: int = 100) -> list[dict[str, Any]]:
    """Processor time of an update [ms], every choice in turns."""
    timers = {"ours TD3": updating(BATCH, True, True, updates=count)}
    timers["stable-baselines3 TD3, fused Adam"] = updating(BATCH, False, True, updates=count)
    timers |= {name: library_updating(kind, updates=count) for name, kind in KINDS.items()}
    samples: dict[str, list[float]] = {name: [] for name in timers}
    for _ in range(rounds):
        for name, once in timers.items():
            samples[name].append(1e3 * once())
    ours = samples["ours TD3"]
    rows = []
    for name, found in samples.items():
        ratio = float(np.median([a / b for a, b in zip(found, ours, strict=True)]))
        rows.append(
            {"what": name, "ms": float(np.median(found)), "range": [min(found), max(found)], "over_ours": ratio}
        )
        print(
            f"{name:36} {rows[-1]['ms']:6.2f} ms ({min(found):.2f} to {max(found):.2f}), {ratio:.2f} of ours",
            flush=True,
        )
    return rows


def reach(name: str, seed: int) -> dict[str, Any]:
    """Success over processor time of one algorithm."""
    envs = VecNormalize(make_sb3(REACH, 8, seed=seed, threads=1, visual=False), norm_reward=False)
    critics = {"n_critics": 1} if "TQC" in name else {}
    model = KINDS[name](
        "MultiInputPolicy", envs, buffer_size=100_000, batch_size=256, gamma=0.95, learning_starts=1000, train_freq=1,
        learning_rate=lambda left: 1e-3 * left, gradient_steps=8, replay_buffer_class=HerReplayBuffer,
        replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future"},
        policy_kwargs={"net_arch": [64, 64], **critics}, seed=seed, device="cpu",
    )  # fmt: skip
    watch = Watch(name)
    model.learn(STEPS, log_interval=None, callback=watch)
    wins = round(EPISODES * watch.curve[-1]["success"])
    return {"what": name, "seed": seed, "curve": watch.curve, "ci95": wilson(wins, EPISODES)}


class Watch(BaseCallback):  # type: ignore[misc]
    """Notes success and the processor time that training took until then."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self._name, self._busy, self._since = name, 0.0, time.process_time()
        self._examiner = make_sb3(REACH, EPISODES, threads=1, visual=False)
        self.curve: list[dict[str, Any]] = []

    def _on_step(self) -> bool:
        if self.num_timesteps % EVERY:
            return True
        self._busy += time.process_time() - self._since
        wins = succeeded(self.model, self.model.get_vec_normalize_env(), self._examiner)
        row = {"steps": self.num_timesteps, "processor_seconds": round(self._busy, 1), "success": wins / EPISODES}
        self.curve.append(row)
        print(f"{self._name:20} {row}", flush=True)
        self._since = time.process_time()
        return True


def succeeded(model: Any, envs: Any, examiner: Any) -> int:
    """Episodes that end in success, all side by side, without exploration."""
    examiner.seed(FIRST_SEED)
    seen, wins = examiner.reset(), None
    while wins is None:
        action, _ = model.predict(envs.normalize_obs(seen), deterministic=True)
        seen, _, done, infos = examiner.step(action)
        if done.all():
            wins = sum(bool(one["is_success"]) for one in infos)
    return wins


def main() -> None:
    """Measure what is asked, both unless told; what is measured anew takes the place of what was there."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", nargs="*", default=PARTS, choices=PARTS)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=REACHING, choices=REACHING, help="algorithms that reach")
    given = parser.parse_args()
    torch.set_num_threads(1)
    path = RESULTS / f"{NAME}.json"
    results = json.loads(path.read_text())["results"] if path.exists() else {}
    about = {"machine": machine(), "versions": {name: version(name) for name in LIBRARIES}}
    if "updates" in given.what:
        rows = updates(given.rounds)
        results["updates"] = {"env": ENV, "networks": NETWORKS, "batch": BATCH, "rows": rows, **about}
    if "reach" in given.what:
        there = {(row["what"], row["seed"]): row for row in results.get("reach", [])}
        for name in given.only:
            for seed in range(given.seeds):
                there[name, seed] = {**reach(name, seed), **about}
        results["reach"] = list(there.values())
    print("saved", save(NAME, results, command=f"python benchmarks/{NAME}.py --seeds 3").name)


if __name__ == "__main__":
    main()
