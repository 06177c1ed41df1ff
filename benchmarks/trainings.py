"""Trainings that a benchmark compares: its options, and their processes."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any


def parser(about: str | None, *, steps: int, seeds: int) -> argparse.ArgumentParser:
    """Options of a benchmark that trains: folder, steps, seeds, episodes, jobs."""
    made = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("folder", type=Path, help="of the trainings; goes on where it stopped")
    made.add_argument("--steps", type=int, default=steps, help="environment steps of a training")
    made.add_argument("--seeds", type=int, default=seeds)
    made.add_argument("--episodes", type=int, default=20, help="that no training used")
    made.add_argument("--jobs", type=int, default=2, help="processes at once")
    return made


def train(env: str, trainings: Mapping[str, Sequence[str]], arguments: argparse.Namespace) -> None:
    """Train, or go on: for each name in the arguments' folder, words beyond the arguments' steps and seeds."""
    common = ["train", "--env", env, "--steps", str(arguments.steps), "--seeds", str(arguments.seeds), "--jobs", "1"]
    with ThreadPoolExecutor(arguments.jobs) as pool:
        jobs = [[*common, "--quiet", *more, "--out", str(arguments.folder / name)] for name, more in trainings.items()]
        list(pool.map(lambda words: tiago_mj(*words), jobs))


def options(given: Mapping[str, Any]) -> list[str]:
    """Arguments of an environment as words."""
    return [word for key, value in given.items() for word in ("--env-option", f"{key}={json.dumps(value)}")]


def tiago_mj(*words: str) -> None:
    """Run a command of the package in a process of its own, on one thread.

    Raises:
        SystemExit: it failed.
    """
    done = subprocess.run(
        [sys.executable, "-m", "tiago_mj.cli", *words],
        capture_output=True, text=True, check=False, env={**os.environ, "OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    if done.returncode:
        raise SystemExit(f"tiago-mj {' '.join(words)} failed:\n{done.stderr[-2000:]}")
