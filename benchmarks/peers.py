"""The environments beside their peers, in one run: steps per second, reset time, memory, and ratios.

    python benchmarks/peers.py [--tiago-rl PATH] [--rounds 5] [--seconds 3]

Peers: gymnasium-robotics' Fetch tasks and its Shadow hand with touch sensors (mujoco 3.3.7: they do not run on later
ones), gymnasium's SyncVectorEnv and AsyncVectorEnv, and the original PyBullet environments where a checkout of
github.com/llach/tiago_rl is given. Each peer has a virtual environment of its own, made at the first run (`--venvs`).

A round runs every contender once, in a process of its own, so that ratios are taken between neighbours in time; medians
over the rounds are told. Half of the episodes are random actions, the other half closes the fingers and holds.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import venv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from machine import save
from measuring import in_a_process, middle, save_samples

WORKER = str(Path(__file__).with_name("peer_worker.py"))
PACKAGES = {
    "robotics": ("mujoco==3.3.7", "gymnasium-robotics==1.4.2"),
    "tiago_rl": ("pybullet==3.2.7", "gym==0.26.2", "numpy<2"),
}


@dataclass(frozen=True)
class Contender:
    """What is measured.

    Attributes:
        label: in the results.
        kind, name: for the worker.
        period: of a control step [s].
        num_envs: simulations at once.
        beside: label of what its rate is divided by.
    """

    label: str
    kind: str
    name: str
    period: float
    num_envs: int = 1
    beside: str | None = None


def contenders(original: bool, processors: int, num_envs: int) -> list[Contender]:
    """In the order of a round: neighbours in a ratio are neighbours in time."""
    found: list[Contender] = []
    for ours, theirs in (("GripperTactile-v0", "GripperTactileEnv"), ("TIAGoTactile-v0", "TIAGoTactileEnv")):
        beside = f"original {theirs}" if original else None
        if original:
            found.append(Contender(f"original {theirs}", "tiago_rl", theirs, 1 / 240))
        found += [
            Contender(ours, "ours", ours, 1 / 240, beside=beside),
            Contender(f"{ours} vector", "ours_vector", ours, 1 / 240, num_envs, beside),
            Contender(f"{ours} SyncVectorEnv", "ours_sync", ours, 1 / 240, 8, ours),
            Contender(f"{ours} AsyncVectorEnv", "ours_async", ours, 1 / 240, processors, ours),
        ]
    for ours, theirs in (
        ("TIAGoReach-v0", "FetchReach-v4"),
        ("TIAGoPush-v0", "FetchPush-v4"),
        ("TIAGoPickAndPlace-v0", "FetchPickAndPlace-v4"),
        ("TIAGoPickAndPlaceTactile-v0", "HandManipulateBlock_ContinuousTouchSensors-v1"),
    ):
        found += [
            Contender(theirs, "robotics", theirs, 0.04),
            Contender(f"{theirs} AsyncVectorEnv", "robotics_async", theirs, 0.04, processors),
            Contender(ours, "ours", ours, 0.04, beside=theirs),
            Contender(f"{ours} vector", "ours_vector", ours, 0.04, num_envs, f"{theirs} AsyncVectorEnv"),
        ]
    return found


def interpreter(kind: str, folder: Path) -> str:
    """Python of a peer's virtual environment, which is made where it is missing."""
    here = folder / kind
    python = here / ("Scripts" if os.name == "nt" else "bin") / "python"
    if not python.exists():
        print(f"making the virtual environment of {kind}: {' '.join(PACKAGES[kind])}")
        venv.create(here, with_pip=True)
        done = subprocess.run(
            [str(python), "-m", "pip", "install", "-q", *PACKAGES[kind]], capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise SystemExit(f"{kind}: its packages cannot be installed: {done.stderr.strip().splitlines()[-1]}")
    return str(python)


def main() -> None:
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tiago-rl", type=Path, help="checkout of the original; left out: not compared")
    parser.add_argument("--venvs", type=Path, default=Path("build/peers"), help="where peers' environments are made")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=3.0, help="of one sample")
    parser.add_argument("--num-envs", type=int, default=64, help="of the vector environment")
    parser.add_argument("--only", nargs="*", help="labels that contain one of these words")
    parser.add_argument("--name", default="peers", help="of the file in results/")
    given = parser.parse_args()
    if given.tiago_rl and not (given.tiago_rl / "tiago_rl" / "envs").is_dir():
        raise SystemExit(f"--tiago-rl {given.tiago_rl}: no tiago_rl/envs there; give the folder of a checkout")
    chosen = [
        c
        for c in contenders(bool(given.tiago_rl), processors, given.num_envs)
        if not given.only or any(word in c.label for word in given.only)
    ]
    pythons = {
        kind: interpreter(kind, given.venvs)
        for kind in PACKAGES
        if any(contender.kind.startswith(kind) for contender in chosen)
    }
    rows: dict[str, list[dict[str, float]]] = {contender.label: [] for contender in chosen}
    for _ in range(given.rounds):
        for one in chosen:
            python = pythons.get(one.kind.removesuffix("_async"), sys.executable)
            folder = str(given.tiago_rl.resolve()) if given.tiago_rl else ""
            words = [one.kind, one.name, str(given.seconds), str(one.num_envs), folder]
            rows[one.label].append(in_a_process(WORKER, words, python))
    results = {one.label: summary(one, rows) for one in chosen}
    for label, row in results.items():
        times = f"{row['times']:7.2f} x {row['beside']}" if row["times"] else ""
        print(f"{label:52}{row['steps_per_second']:10.0f} /s {row['times_real_time']:8.1f} x real time {times}")
    command = "python benchmarks/peers.py" + (" --tiago-rl PATH" if given.tiago_rl else "")
    found = {"packages": PACKAGES, "processors": processors, "rows": results}
    print("saved", save(given.name, found, f"{command} --rounds {given.rounds} --seconds {given.seconds:g}").name)
    save_samples(given.name, {k: [1 / sample["steps_per_second"] for sample in v] for k, v in rows.items()})


def summary(one: Contender, rows: dict[str, list[dict[str, float]]]) -> dict[str, Any]:
    """Medians of one contender, and its ratios to the one beside it."""
    mine = rows[one.label]
    found: dict[str, Any] = {key: middle([row[key] for row in mine]) for key in mine[0]}
    found |= {"num_envs": one.num_envs, "times_real_time": found["steps_per_second"] * one.period}
    beside = one.beside if one.beside in rows else None
    found |= {"beside": beside, "times": None, "reset_times_faster": None}
    if beside is not None:
        pairs = list(zip(mine, rows[beside], strict=True))
        found["times"] = middle([a["steps_per_second"] / b["steps_per_second"] for a, b in pairs])
        if all("reset_ms" in row for pair in pairs for row in pair):
            found["reset_times_faster"] = middle([b["reset_ms"] / a["reset_ms"] for a, b in pairs])
    return found


if __name__ == "__main__":
    main()
