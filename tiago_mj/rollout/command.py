"""``tiago-mj rollout``: run a policy, print what came of it, film it."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from tiago_mj.io.progress import Progress
from tiago_mj.rollout import options
from tiago_mj.rollout.episode import Episode
from tiago_mj.rollout.policies import RANDOM
from tiago_mj.rollout.sweep import Batch, play_all, play_in
from tiago_mj.view.film import STRIP_FRAMES, Film

HEADER = ("episode", "seed", "return", "success", "both contacts", "final right", "final left", "peak")
UNITS = ("", "", "", "", "s", "sensor u.", "sensor u.", "sensor u.")


def run(arguments: argparse.Namespace) -> int:
    """Run the command.

    Raises:
        ValueError: an argument is unusable; says which and how to mend it.
    """
    seeds = options.seeds_of(arguments)
    policy = arguments.policy
    if policy not in ("pi", RANDOM) and Path(policy).exists():
        policy = str(Path(policy).resolve())  # processes of a cluster have another working directory
    given = options.read_options(arguments.env_option)
    batch = Batch(options.environment_id(arguments.env), given, policy, seeds, arguments.trust)
    film = None
    if arguments.film is None:
        with Progress("rollout", quiet=arguments.json) as progress:
            progress.stage("episodes", len(seeds))
            episodes = play_all(batch, jobs=arguments.jobs, backend=arguments.backend, done=progress.advance)
    else:
        if arguments.jobs != 1 or arguments.backend != "local":
            raise ValueError("--film shows the episodes of one process: leave out --jobs and --backend, or --film")
        env = options.make_env(batch.env, given, render_mode="rgb_array")
        try:
            film = Film(env)
            film.check()
            with Progress("rollout", quiet=arguments.json) as progress:
                progress.stage("episodes")
                episodes = play_in(env, batch, watch=film)
                strip = arguments.film.suffix.lower() == ".png"
                progress.stage("drawing frames", STRIP_FRAMES if strip else len(film.snapshots))
                film.write(arguments.film, processes=None, done=progress.at)
        finally:
            env.close()
    if arguments.json:
        print(json.dumps(as_data(batch, arguments, episodes), indent=2))
        return 0
    print(table(episodes))
    print(f"{batch.env}, policy {arguments.policy}: {in_a_line(episodes)}")
    if film is not None:
        print(f"film: {arguments.film} ({film.slow_motion} times slower than life)")
    return 0


def table(episodes: list[Episode]) -> str:
    """One line an episode, columns aligned."""
    rows: list[tuple[str, ...]] = [HEADER, UNITS]
    for number, episode in enumerate(episodes, 1):
        forces = tuple(f"{force:.3f}" for force in episode.final_force) or ("-", "-")
        rows.append(
            (
                str(number),
                str(episode.seed),
                f"{episode.episode_return:.2f}",
                "yes" if episode.success else "no",
                "-" if episode.both_contacts is None else f"{episode.both_contacts:.3f}",
                *forces,
                "-" if episode.peak_force is None else f"{episode.peak_force:.3f}",
            )
        )
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEADER))]
    return "\n".join("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows)


def in_a_line(episodes: list[Episode]) -> str:
    """Mean and spread of the returns, and the share of successes."""
    returns = np.array([episode.episode_return for episode in episodes])
    spread = f" ± {returns.std(ddof=1):.2f}" if len(returns) > 1 else ""
    successes = sum(episode.success for episode in episodes)
    return f"return {returns.mean():.2f}{spread}, {successes} of {len(episodes)} episodes end in success"


def as_data(batch: Batch, arguments: argparse.Namespace, episodes: list[Episode]) -> dict[str, Any]:
    """What ``--json`` prints."""
    returns = [episode.episode_return for episode in episodes]
    return {
        "env": batch.env,
        "env_options": batch.env_options,
        "policy": arguments.policy,
        "episodes": [asdict(episode) for episode in episodes],
        "return_mean": float(np.mean(returns)),
        "return_sd": float(np.std(returns, ddof=1)) if len(returns) > 1 else None,
        "success_rate": float(np.mean([episode.success for episode in episodes])),
        "film": None if arguments.film is None else str(arguments.film),
    }
