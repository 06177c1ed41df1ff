"""Stable-baselines3's PPO on the steady task as docs/learning.md prints it: what it learns and costs, and its rate.

    python benchmarks/stock_ppo.py [recipe|rate|shipped] [--seeds 3]

``recipe``: the lines of the page, once a seed; then PI controllers and agents play the same 50 episodes, which no
training used, with the task's own reward. ``rate``: environment steps per second of PPO on one environment with its
default arguments, and on 64 with the recipe's batches. ``shipped``: the agent that comes with the package beside
``pi-tuned`` on 200 other episodes. Times are of the process (all its threads) and of the clock, beside the load.
Without a part, all; writes ``results/learning_stock_ppo.json``.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import gymnasium
import torch
from differences import difference
from machine import RESULTS, machine, save
from scripted_experts import wilson
from stable_baselines3 import PPO

from tiago_mj.evaluate.play import Played, play_policy
from tiago_mj.learn.export import agent_of
from tiago_mj.rollout.options import make_env
from tiago_mj.vector.sb3 import make_sb3

NAME: Final = "learning_stock_ppo"
PARTS: Final = ("recipe", "rate", "shipped")
PAGE: Final = Path(__file__).parents[1] / "docs" / "learning.md"
ENV: Final = "tiago_mj/GripperTactileSteady-v0"
PAPER: Final = "tiago_mj/GripperTactile-v0"
SHIPPED: Final = "ppo-steady"
#: Of the recipe's episodes, here and on the page; of those that the agent of the package plays.
FIRST_SEED, EPISODES = 900_000, 50
FIRST_OF_SHIPPED, SHIPPED_EPISODES = 910_000, 200
_BLOCK: Final = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_SEED: Final = "\nseed = 0\n"


def recipe(seed: int) -> str:
    """The page's lines, with another seed."""
    found = [text for text in _BLOCK.findall(PAGE.read_text(encoding="utf-8")) if _SEED in text]
    if len(found) != 1:
        raise ValueError(f"{PAGE.name} has {len(found)} blocks of Python with a line 'seed = 0': it has to have one")
    return str(found[0]).replace(_SEED, f"\nseed = {seed}\n", 1)


def trained(seed: int) -> tuple[Any, dict[str, Any]]:
    """The model that the page's lines train, and what they cost and print."""
    names: dict[str, Any] = {}
    load, clock, processor = os.getloadavg()[0], time.perf_counter(), time.process_time()
    exec(compile(recipe(seed), str(PAGE), "exec"), names)
    return names["model"], {
        "seed": seed,
        "steps": names["model"].num_timesteps,
        "processor_s": time.process_time() - processor,
        "clock_s": time.perf_counter() - clock,
        "load": [load, os.getloadavg()[0]],
        "success_as_printed": float(names["success"]),
    }


def facts(played: Played) -> dict[str, Any]:
    """Success with its interval, mean return, error at rest and contact of a controller's episodes."""
    won = int(sum(one.success for one in played.metrics))
    rest = [one.rest_error for one in played.metrics if one.rest_error is not None]
    shares = [one.contact_share or 0.0 for one in played.metrics]
    return {
        "episodes": len(played.metrics),
        "success": won / len(played.metrics),
        "success_interval": wilson(won, len(played.metrics)),
        "reward": sum(one.reward for one in played.metrics) / len(played.metrics),
        "rest_error": sum(rest) / len(rest),
        "contact_share": sum(shares) / len(shares),
        "bounces": sum(one.bounces or 0.0 for one in played.metrics) / len(played.metrics),
    }


def beside(ours: Played, theirs: Played) -> dict[str, Any]:
    """Differences of return and success, episode by episode."""
    pairs = list(zip(ours.metrics, theirs.metrics, strict=True))
    return {
        name: difference([getattr(one, name) for one, _ in pairs], [getattr(other, name) for _, other in pairs])
        for name in ("reward", "success")
    }


def compared(policies: Mapping[str, str], seeds: Sequence[int]) -> dict[str, Any]:
    """Facts of every controller, and its differences from ``pi-tuned`` on the same episodes."""
    env = make_env(ENV, {})
    try:
        played = {name: play_policy(env, policy, name=name, seeds=seeds) for name, policy in policies.items()}
    finally:
        env.close()
    return {
        name: {**facts(one), **({} if name == "pi-tuned" else {"beside_pi_tuned": beside(one, played["pi-tuned"])})}
        for name, one in played.items()
    }


def learned(seeds: int) -> dict[str, Any]:
    """Cost of every seed's training, and how good its agent is."""
    costs = []
    with tempfile.TemporaryDirectory() as folder:
        policies = {"pi": "pi", "pi-tuned": "pi-tuned"}
        for seed in range(seeds):
            model, cost = trained(seed)
            costs.append(cost)
            path = Path(folder) / f"seed-{seed}.npz"
            agent_of(model).save(path)
            policies[f"seed {seed}"] = str(path)
            print(json.dumps(cost), flush=True)
        played = compared(policies, range(FIRST_SEED, FIRST_SEED + EPISODES))
    return {"threads": torch.get_num_threads(), "trainings": costs, "episodes": played}


def rate(env: Any, steps: int, **arguments: Any) -> dict[str, Any]:
    """Environment steps per second of PPO's collecting and updating, by the processor and by the clock."""
    model = PPO("MlpPolicy", env, seed=0, device="cpu", **arguments)
    load, clock, processor = os.getloadavg()[0], time.perf_counter(), time.process_time()
    model.learn(steps)
    done = model.num_timesteps
    found = {
        "steps": done,
        "steps_per_processor_s": done / (time.process_time() - processor),
        "steps_per_clock_s": done / (time.perf_counter() - clock),
        "load": load,
    }
    env.close()
    return found


def rates() -> dict[str, Any]:
    """One environment and PPO's default arguments, beside 64 and the recipe's rollouts and batches."""
    torch.set_num_threads(1)
    batches = {"n_steps": 64, "batch_size": 1024, "policy_kwargs": {"net_arch": [64, 64]}}
    return {
        "one, gymnasium.make": rate(gymnasium.make(PAPER), 4_096),
        "64, make_sb3": rate(make_sb3(PAPER, 64, seed=0), 65_536, **batches),
    }


def shipped() -> dict[str, Any]:
    """The agent that comes with the package beside both PI controllers."""
    seeds = range(FIRST_OF_SHIPPED, FIRST_OF_SHIPPED + SHIPPED_EPISODES)
    return compared({"pi": "pi", "pi-tuned": "pi-tuned", SHIPPED: SHIPPED}, seeds)


def main() -> None:
    """Measure, print, write; parts that are not measured now stay as they were, with the machine of theirs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args()
    path = RESULTS / f"{NAME}.json"
    measure = {"recipe": lambda: learned(arguments.seeds), "rate": rates, "shipped": shipped}
    for part in arguments.parts or PARTS:
        found = {"machine": machine(), "found": measure[part]()}
        print(json.dumps(found["found"], indent=1))
        kept = json.loads(path.read_text())["results"] if path.exists() else {}
        print(save(NAME, {**kept, part: found}, f"python benchmarks/stock_ppo.py --seeds {arguments.seeds}").name)


if __name__ == "__main__":
    main()
