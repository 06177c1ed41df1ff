"""Success rates and final distances of the scripted experts in the reach, push and pick-and-place tasks.

    python benchmarks/scripted_experts.py [--episodes 1000] [ID ...]

`success`: share of episodes that end in success, seeds 0 and up; `ci95` its Wilson interval. `random` and `still`: the
same for random and for zero actions. `steps`: control steps until success stays (median, 95 %, most). `touched`:
episodes in which the robot touches itself (fingertips apart: closed, they may) or anything but the object.
`clearance`: smallest distance of the robot to the table [m]. `limit`: smallest distance of an arm joint to its soft
limits [rad], below 0 beyond them (the pre-grasp pose, where the reach task starts, has arm_1 0.031 rad beyond its).
"""

from __future__ import annotations

import argparse
import json
from typing import Any

import gymnasium
import mujoco
import numpy as np
from machine import RESULTS, machine, save

import tiago_mj
from tiago_mj.control.scripted import Scripted
from tiago_mj.models import names
from tiago_mj.models.limits import joint_limits

IDS = [f"{task}{touch}-v0" for task in ("TIAGoReach", "TIAGoPush", "TIAGoPickAndPlace") for touch in ("", "Tactile")]


def wilson(successes: int, episodes: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson 1927)."""
    z, share = 1.96, successes / episodes
    middle = (share + z**2 / (2 * episodes)) / (1 + z**2 / episodes)
    half = z * np.sqrt(share * (1 - share) / episodes + z**2 / (4 * episodes**2)) / (1 + z**2 / episodes)
    return float(middle - half), float(min(middle + half, 1.0))


class Watch:
    """How close the robot comes to the table and to its joints' limits, and what it touches."""

    def __init__(self, core: Any) -> None:
        model = core.model
        self.model, self.data = model, core.data
        self.table = model.geom(names.TABLE_GEOM).id
        self.object = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, names.OBJECT_GEOM)  # -1: there is none
        self.pads = {model.geom(name).id for name in names.PAD_GEOM.values()}
        solid = {geom for geom in range(model.ngeom) if model.geom_contype[geom] or model.geom_conaffinity[geom]}
        shoulder = model.body("arm_1_link").id
        self.robot = {geom for geom in solid if model.geom_bodyid[geom]} - {self.object}
        self.arm_geoms = [geom for geom in self.robot if model.geom_bodyid[geom] >= shoulder]  # bodies go depth first
        self.arm = [core.joints.index(name) for name in names.ARM]
        limits = [joint_limits(model, name) for name in names.ARM]
        self.low = np.array([limit.soft_lower for limit in limits])
        self.high = np.array([limit.soft_upper for limit in limits])
        self.clearance, self.limit = np.inf, np.inf

    def look(self, joints: np.ndarray) -> bool:
        """Take a step into account; whether the robot touches anything but the object."""
        for geom in self.arm_geoms:
            near = mujoco.mj_geomDistance(self.model, self.data, geom, self.table, 0.5, None)
            self.clearance = min(self.clearance, float(near))
        q = joints[self.arm]
        self.limit = min(self.limit, float(np.minimum(q - self.low, self.high - q).min()))
        pairs = (set(pair) for pair in self.data.contact.geom[: self.data.ncon].tolist())
        return any(self.robot & pair and self.object not in pair and pair != self.pads for pair in pairs)


def play(name: str, policy: str, episodes: int) -> dict[str, Any]:
    """Episodes of one environment under ``expert``, ``random`` or ``still``."""
    env = gymnasium.make(f"{tiago_mj.registration.NAMESPACE}/{name}")
    core: Any = env.unwrapped
    expert = Scripted.for_env(env)
    watch = Watch(core)
    rng = np.random.default_rng(0)
    wins, touched, settled = 0, 0, []
    for seed in range(episodes):
        observation, info = env.reset(seed=seed)
        expert.reset()
        since, step, done, touches = None, 0, False, False
        while not done:
            action = np.zeros(10)
            if policy == "expert":
                action = expert(observation, info)
            elif policy == "random":
                action = rng.uniform(-1, 1, 10)
            observation, _, _, done, info = env.step(action)
            step += 1
            since = (since or step) if info["is_success"] else None
            if policy == "expert":
                touches |= watch.look(observation["observation"])
        wins += bool(info["is_success"])
        touched += touches
        if since is not None:
            settled.append(since)
    env.close()
    if policy != "expert":
        return {"success": wins / episodes}
    steps = [float(value) for value in np.percentile(settled, [50, 95, 100])]
    return {
        "success": wins / episodes,
        "ci95": wilson(wins, episodes),
        "steps": steps,
        "touched": touched,
        "clearance": watch.clearance,
        "limit": watch.limit,
    }


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("ids", nargs="*", default=IDS, help="all unless told; rows of others stay")
    arguments.add_argument("--episodes", type=int, default=1000)
    given = arguments.parse_args()
    path, episodes = RESULTS / "scripted_experts.json", given.episodes
    kept = json.loads(path.read_text())["results"] if path.exists() else []
    rows = {row["id"]: row for row in kept}
    for name in given.ids:
        row = {"id": name, "episodes": episodes, **play(name, "expert", episodes)}
        row["random"] = play(name, "random", episodes)["success"]
        row["still"] = play(name, "still", episodes)["success"]
        rows[name] = {**row, "machine": machine()}
        print(
            f"{name:28} success {row['success']:.3f} ({row['ci95'][0]:.3f} to {row['ci95'][1]:.3f})"
            f"  random {row['random']:.3f}  still {row['still']:.3f}  steps {row['steps']}"
            f"  touched {row['touched']}  clearance {row['clearance']:.4f} m  limit {row['limit']:.3f} rad",
            flush=True,
        )
    print("saved", save("scripted_experts", [rows[name] for name in IDS if name in rows]).name)


if __name__ == "__main__":
    main()
