"""How the vector environment's rate grows with threads and with the number of simulations.

    python benchmarks/scaling.py [--rounds 5] [ID ...]

The load is `grasp` of benchmarks/steps_per_second.py. A round takes one sample of every combination, and one of MuJoCo
alone on one thread, whose multiple by the number of threads is the limit.
"""

from __future__ import annotations

import argparse
import json
import os
from typing import Any

import gymnasium
from machine import save
from measuring import in_a_process, middle, raw_seconds, save_samples, vector_seconds

import tiago_mj  # noqa: F401

IDS = ("GripperTactile-v0", "TIAGoTactile-v0")
SIMULATIONS = (1, 4, 16, 64, 256, 1024)


def measure(name: str, rounds: int, threads: list[int], simulations: list[int]) -> dict[str, Any]:
    alone = gymnasium.make(f"tiago_mj/{name}")
    made = {
        (t, n): gymnasium.make_vec(f"tiago_mj/{name}", num_envs=n, threads=t, autoreset_mode="SameStep")
        for t in threads
        for n in simulations
        if n >= t
    }
    raw: list[float] = []
    taken: dict[tuple[int, int], list[float]] = {key: [] for key in made}
    for k in range(rounds):
        spent, steps = raw_seconds(alone, "grasp", k)
        raw.append(spent / steps)
        for key, envs in made.items():
            spent, steps = vector_seconds(envs, "grasp", k)
            taken[key].append(spent / steps)
    rows = [
        {
            "threads": t,
            "num_envs": n,
            "steps_per_second": 1 / middle(values),
            "share_of_limit": middle([r / t / v for r, v in zip(raw, values, strict=True)]),
            "times_one_thread": middle([a / b for a, b in zip(taken[1, n], values, strict=True)])
            if (1, n) in taken
            else None,
        }
        for (t, n), values in taken.items()
    ]
    samples = {f"{name} {t} threads {n} simulations": values for (t, n), values in taken.items()}
    return {
        "figures": {"mujoco_alone_steps_per_second": 1 / middle(raw), "rows": rows},
        "samples": {**samples, f"{name} MuJoCo alone": raw},
    }


def main() -> None:
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("ids", nargs="*", default=list(IDS))
    parser.add_argument("--rounds", type=int, default=5, help="samples of each")
    parser.add_argument("--threads", type=int, nargs="*", default=list(range(1, processors + 1)))
    parser.add_argument("--num-envs", type=int, nargs="*", default=list(SIMULATIONS))
    parser.add_argument("--name", default="scaling", help="of the file in results/")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(measure(given.one, given.rounds, given.threads, given.num_envs)))
        return
    results, samples = {}, {}
    for name in given.ids:
        words = ["--one", name, "--rounds", str(given.rounds), "--threads", *map(str, given.threads)]
        found = in_a_process(os.path.abspath(__file__), [*words, "--num-envs", *map(str, given.num_envs)])
        results[name] = found["figures"]
        samples |= found["samples"]
        print(
            f"{name}: MuJoCo alone {results[name]['mujoco_alone_steps_per_second']:.0f} control steps/s on one thread"
        )
        for row in results[name]["rows"]:
            print(
                f"  {row['threads']} threads {row['num_envs']:5} simulations {row['steps_per_second']:9.0f} /s, "
                f"{row['share_of_limit']:.0%} of the limit"
            )
    print("saved", save(given.name, results).name)
    save_samples(given.name, samples)


if __name__ == "__main__":
    main()
