"""``tiago-mj rollout``: run a policy, print what came of it, film it."""

from __future__ import annotations

import argparse
import json
import shlex
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from tiago_mj.envs.flat import core_of
from tiago_mj.io import atomic
from tiago_mj.io.aligned import aligned
from tiago_mj.io.progress import Progress
from tiago_mj.io.quoting import one_line
from tiago_mj.recordings.record.environment import Logged, Plan, servo_facts, trial_of
from tiago_mj.recordings.write import write_trial
from tiago_mj.rollout import options
from tiago_mj.rollout.episode import Episode, summarise
from tiago_mj.rollout.policies import absolute
from tiago_mj.rollout.sweep import Batch, play_all, play_in, play_seeds
from tiago_mj.view.film import STRIP_FRAMES, Film

HEADER = ("episode", "seed", "return", "success", "both contacts", "final right", "final left", "peak")
UNITS = ("", "", "", "", "s", "sensor u.", "sensor u.", "sensor u.")


def run(arguments: argparse.Namespace) -> int:
    """Run the command.

    Raises:
        ValueError: an argument is unusable; says which and how to mend it.
    """
    seeds = options.seeds_of(arguments)
    given = options.read_options(arguments.env_option)
    batch = Batch(options.environment_id(arguments.env), given, absolute(arguments.policy), seeds, arguments.trust)
    film = None
    alone = arguments.jobs == 1 and arguments.backend == "local"
    if arguments.record is not None:
        if not alone or arguments.film is not None:
            raise ValueError("--record logs the episodes of one process: leave out --film, --jobs and --backend")
        with Progress("rollout", quiet=arguments.json) as progress:
            progress.stage("episodes", len(seeds))
            episodes = logged(batch, arguments.record, progress.advance)
    elif arguments.film is None:
        with Progress("rollout", quiet=arguments.json) as progress:
            progress.stage("episodes", len(seeds))
            episodes = play_all(batch, jobs=arguments.jobs, backend=arguments.backend, done=progress.advance)
    else:
        if not alone:
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
    if arguments.record is not None:
        print(f"recordings: {one_line(arguments.record)}")
        print(f"next: tiago-mj diagnose {shlex.quote(str(arguments.record))} --out diagnosis")
    return 0


def logged(batch: Batch, folder: Path, done: Callable[[], None] = lambda: None) -> list[Episode]:
    """Play a batch, and write each episode as a recording of the robot would be: all or none.

    Effects among the environment's options act, and stay out of the recordings.
    """
    arguments = {key: value for key, value in batch.env_options.items() if key != "effects"}
    plan = Plan(batch.env, arguments, batch.env_options.get("effects"), None, Path(batch.policy).stem)
    nominal = options.make_env(batch.env, arguments)
    servo = servo_facts(core_of(nominal))
    nominal.close()
    env = Logged(options.make_env(batch.env, batch.env_options))
    episodes = []
    try:
        with atomic.replacing_set(folder) as new:
            for trace, seed in zip(
                play_seeds(env, batch.policy, batch.seeds, trust=batch.trust), batch.seeds, strict=True
            ):
                write_trial(trial_of(plan, core_of(env), servo, seed, env.logged()), new)
                episodes.append(summarise(trace, seed))
                done()
    finally:
        env.close()
    return episodes


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
    return "\n".join(aligned(rows))


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
        "recordings": None if arguments.record is None else str(arguments.record),
    }
