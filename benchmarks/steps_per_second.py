"""Steps per second, reset time and peak memory of every scalar environment, each in a process of its own.

    python benchmarks/steps_per_second.py [--seconds 3] [ID ...]

Two loads: `random` actions, and `grasp`: the fingers close in the first half of an episode and hold what there is to
hold in the second, so that half of the time is spent in the contacts that cost. Rates include resets and are one
process on one core; on a shared machine compare them within a run only.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time

from machine import save

IDS = ("GripperTactile-v0", "TIAGoTactile-v0", "TIAGoPALGripper-v0")


def measure(name: str, seconds: float) -> dict[str, float]:
    import gymnasium
    import numpy as np

    import tiago_mj  # noqa: F401

    env = gymnasium.make(f"tiago_mj/{name}")
    limit = env.spec.max_episode_steps
    n = env.action_space.shape[0]
    rng = np.random.default_rng(0)
    close = np.zeros(n)
    close[-2:] = -1.0
    loads = {
        "random": lambda step: actions[step],
        "grasp": lambda step: close if step < limit // 2 else 0 * close,
    }
    figures: dict[str, float] = {}
    for load, action in loads.items():
        steps, resets, in_reset = 0, 0, 0.0
        begin = time.perf_counter()
        while time.perf_counter() - begin < seconds:
            started = time.perf_counter()
            env.reset(seed=resets)
            in_reset += time.perf_counter() - started
            resets += 1
            actions = rng.uniform(-1, 1, (limit, n))
            for step in range(limit):
                env.step(action(step))
            steps += limit
        figures[f"steps_per_second_{load}"] = steps / (time.perf_counter() - begin)
        figures[f"reset_ms_{load}"] = in_reset / resets * 1e3
    figures["peak_memory_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("ids", nargs="*", default=IDS)
    parser.add_argument("--seconds", type=float, default=3.0, help="of each load")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(measure(arguments.one, arguments.seconds)))
        return
    results = {}
    for name in arguments.ids:
        command = [sys.executable, __file__, "--one", name, "--seconds", str(arguments.seconds)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        results[name] = json.loads(done.stdout.splitlines()[-1])
        print(f"{name:24}" + "  ".join(f"{key} {value:.4g}" for key, value in results[name].items()))
    print("saved", save("steps_per_second", results).name)


if __name__ == "__main__":
    main()
