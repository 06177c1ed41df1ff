"""One sample of one contender of benchmarks/peers.py, in whatever virtual environment runs this file.

    python peer_worker.py KIND ID SECONDS [NUM_ENVS] [FOLDER]

KIND: `ours`, `ours_vector`, `ours_sync`, `ours_async`, `robotics`, `robotics_async`, or `tiago_rl` with the folder of
a checkout. It prints a line of JSON: steps per second with resets and without, a reset's milliseconds, memory.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from typing import Any

import numpy as np


def scalar(env: Any, limit: int, joints: int, seconds: float, seeded: bool, bound: float) -> dict[str, float]:
    """Random actions and, every second episode, closing fingers and a hold: as much time in a grasp as out of it."""
    rng = np.random.default_rng(0)
    closing = np.zeros((limit, joints), dtype=np.float32)
    closing[: limit // 2, -2:] = -bound
    resets: list[float] = []
    moving: list[float] = []
    begin = time.perf_counter()
    while len(moving) < 4 or time.perf_counter() - begin < seconds:
        given = closing if len(moving) % 2 else rng.uniform(-bound, bound, (limit, joints)).astype(np.float32)
        t0 = time.perf_counter()
        env.reset(seed=0) if seeded and not moving else env.reset()
        t1 = time.perf_counter()
        for action in given:
            env.step(action)
        resets.append(t1 - t0)
        moving.append(time.perf_counter() - t1)
    pairs = len(moving) // 2 * 2  # as many episodes of either load
    return {
        "steps_per_second": pairs * limit / (sum(resets[:pairs]) + sum(moving[:pairs])),
        "steps_per_second_without_resets": pairs * limit / sum(moving[:pairs]),
        "reset_ms": float(np.median(resets)) * 1e3,
    }


def vector(envs: Any, limit: int, joints: int, seconds: float) -> dict[str, float]:
    """The same of many at once; their resets are within their steps."""
    rng = np.random.default_rng(0)
    count, episodes = envs.num_envs, 0
    envs.reset(seed=0)
    begin = time.perf_counter()
    while episodes % 2 or episodes < 2 or time.perf_counter() - begin < seconds:
        for k in range(limit):
            action = rng.uniform(-1, 1, (count, joints)).astype(np.float32)
            if episodes % 2:
                action[:] = 0.0
                action[:, -2:] = -1.0 if k < limit // 2 else 0.0
            envs.step(action)
        episodes += 1
    return {"steps_per_second": episodes * limit * count / (time.perf_counter() - begin)}


def measure(kind: str, name: str, seconds: float, num_envs: int, folder: str) -> dict[str, float]:
    if kind == "tiago_rl":
        sys.path.insert(0, folder)
        from tiago_rl import envs as original

        one = getattr(original, name)(target_force=1.0)
        return scalar(one, 300, one.action_space.shape[0], seconds, seeded=False, bound=float(one.action_space.high[0]))
    import gymnasium

    if kind.startswith("robotics"):
        import gymnasium_robotics

        gymnasium.register_envs(gymnasium_robotics)
    else:
        import tiago_mj  # noqa: F401

        name = f"tiago_mj/{name}"
    limit = gymnasium.spec(name).max_episode_steps or 100
    joints = gymnasium.make(name).action_space.shape[0]
    if kind in ("ours", "robotics"):
        return scalar(gymnasium.make(name), limit, joints, seconds, seeded=True, bound=1.0)
    mode = {"vector": "vector_entry_point"}.get(kind.split("_")[1], kind.split("_")[1])
    return vector(gymnasium.make_vec(name, num_envs=num_envs, vectorization_mode=mode), limit, joints, seconds)


if __name__ == "__main__":
    words = sys.argv[1:] + ["1", ""][len(sys.argv) - 4 :] if len(sys.argv) < 6 else sys.argv[1:]
    found = measure(words[0], words[1], float(words[2]), int(words[3]), words[4])
    found["peak_memory_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps(found))
