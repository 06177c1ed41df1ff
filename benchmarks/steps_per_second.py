"""Steps per second, reset time and memory of every environment, scalar and vector, and the share of the limit.

    python benchmarks/steps_per_second.py [--rounds 7] [--num-envs 64] [--threads 0] [ID ...]

Each environment is measured in a process of its own, under two loads: `random` actions, and `grasp`: the fingers close
in the first half of an episode and hold what there is to hold in the second, so that half of the time is spent in the
contacts that cost. A round takes one sample each of MuJoCo alone (the same model and controls, stepped in C on one
thread), of the scalar environment (`gymnasium.make`), and of the vector environment (`gymnasium.make_vec`). The limit
is threads × MuJoCo alone; shares are taken within a round. Medians over the rounds are saved and printed.
"""

from __future__ import annotations

import argparse
import json
import os
from typing import Any

import gymnasium
from machine import save
from measuring import (
    LOADS,
    episode,
    in_a_process,
    middle,
    raw_seconds,
    resident_mb,
    save_samples,
    vector_seconds,
)

import tiago_mj


def measure(name: str, rounds: int, num_envs: int, threads: int) -> dict[str, Any]:
    """All figures of one environment, and samples [s per step]."""
    before = resident_mb()
    env = gymnasium.make(f"tiago_mj/{name}")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    memory = {"scalar_mb": resident_mb(), "scalar_alone_mb": resident_mb() - before}
    envs = gymnasium.make_vec(f"tiago_mj/{name}", num_envs=num_envs, threads=threads, autoreset_mode="SameStep")
    envs.reset(seed=0)
    figures: dict[str, Any] = {"num_envs": num_envs, "threads": envs.unwrapped.threads, "loads": {}}
    samples: dict[str, list[float]] = {}
    for load in LOADS:
        rows: dict[str, list[float]] = {"raw": [], "scalar": [], "vector": [], "reset": []}
        for k in range(rounds):
            taken, steps = raw_seconds(env, load, k)
            rows["raw"].append(taken / steps)
            reset, taken, steps = episode(env, load, k)
            rows["reset"].append(reset)
            rows["scalar"].append((reset + taken) / steps)
            taken, steps = vector_seconds(envs, load, k)
            rows["vector"].append(taken / steps)
        cores = envs.unwrapped.threads
        shares = [raw / cores / vector for raw, vector in zip(rows["raw"], rows["vector"], strict=True)]
        figures["loads"][load] = {
            "scalar_steps_per_second": 1 / middle(rows["scalar"]),
            "vector_steps_per_second": 1 / middle(rows["vector"]),
            "mujoco_alone_steps_per_second": 1 / middle(rows["raw"]),
            "scalar_share": middle([r / s for r, s in zip(rows["raw"], rows["scalar"], strict=True)]),
            "vector_share_of_limit": middle(shares),
            "reset_ms": middle(rows["reset"]) * 1e3,
        }
        samples |= {f"{name} {load} {what}": values for what, values in rows.items() if what != "reset"}
    envs.close()
    few, many = 1, 1000
    at = []
    for count in (few, many):
        envs = gymnasium.make_vec(f"tiago_mj/{name}", num_envs=count, threads=threads)
        envs.reset(seed=0)
        envs.step(envs.action_space.sample())
        at.append(resident_mb())
    memory["mb_per_simulation"] = (at[1] - at[0]) / (many - few)
    return {"figures": {**figures, **memory}, "samples": samples}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("ids", nargs="*", default=list(tiago_mj.ENVIRONMENTS))
    parser.add_argument("--rounds", type=int, default=7, help="samples of each")
    parser.add_argument("--num-envs", type=int, default=64)
    parser.add_argument("--threads", type=int, default=0, help="of the vector environment; 0: one a processor")
    parser.add_argument("--name", default="steps_per_second", help="of the file in results/")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(measure(given.one, given.rounds, given.num_envs, given.threads)))
        return
    results, samples = {}, {}
    for name in given.ids:
        words = ["--one", name, "--rounds", str(given.rounds), "--num-envs", str(given.num_envs)]
        found = in_a_process(os.path.abspath(__file__), [*words, "--threads", str(given.threads)])
        results[name] = found["figures"]
        samples |= found["samples"]
        for load, row in results[name]["loads"].items():
            print(
                f"{name:28}{load:8} scalar {row['scalar_steps_per_second']:8.0f} /s  "
                f"vector {row['vector_steps_per_second']:8.0f} /s  share of the limit "
                f"{row['vector_share_of_limit']:.0%}  reset {row['reset_ms']:.2f} ms"
            )
    print("saved", save(given.name, results).name)
    save_samples(given.name, samples)


if __name__ == "__main__":
    main()
