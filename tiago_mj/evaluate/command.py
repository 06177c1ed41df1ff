"""``tiago-mj evaluate``: controllers and policies on the same seeds, side by side."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gymnasium

from tiago_mj.cli.evaluate import DATA, PICTURE
from tiago_mj.envs.flat import core_of
from tiago_mj.evaluate import bound, plots, report
from tiago_mj.evaluate.play import Callbacks, play_policy
from tiago_mj.io import atomic
from tiago_mj.io.progress import Progress
from tiago_mj.rollout import options
from tiago_mj.view import figures
from tiago_mj.view.film import Film, check_encoder

#: What the command writes.
FILM = ".mp4"


def run(arguments: argparse.Namespace) -> int:
    """Run the command.

    Raises:
        ValueError: an argument is unusable; says which and how to mend it.
    """
    identifier, seeds = options.environment_id(arguments.env), options.seeds_of(arguments)
    if arguments.film and arguments.out is None:
        raise ValueError("--film needs a folder to put films in: add --out FOLDER")
    if arguments.film:
        check_encoder(FILM)
    given = options.read_options(arguments.env_option)
    more = {"render_mode": "rgb_array"} if arguments.film else {}
    env = options.make_env(identifier, given, **more)
    films: dict[str, Film] = {}
    with Progress("evaluate", quiet=arguments.json) as progress:
        try:
            if arguments.bound:
                bound.check(core_of(env))
            played = []
            for policy, name in zip(arguments.policy, names_of(arguments.policy), strict=True):
                progress.stage(f"{name}, episodes", len(seeds))
                watch = FirstEpisode(env) if arguments.film else None
                callbacks = Callbacks(step=watch, episode=progress.advance)
                one = play_policy(env, policy, name=name, seeds=seeds, trust=arguments.trust, callbacks=callbacks)
                played.append(one)
                if watch is not None:
                    films[name] = watch.film
            progress.stage("bounds", len(seeds))
            bounds = bounds_of(env, seeds, progress.advance) if arguments.bound else []
        finally:
            env.close()
        progress.stage("writing")
        evaluation = report.Evaluation(identifier, given, played, bounds)
        written = [] if arguments.out is None else write(evaluation, arguments.out, films)
    if arguments.json:
        print(json.dumps(report.as_data(evaluation), indent=1, allow_nan=False))
        return 0
    report.show(evaluation)
    if written:
        print("written: " + ", ".join(str(path) for path in written))
    return 0


def names_of(policies: Sequence[str]) -> list[str]:
    """Names of policies in tables: the stem of a file; a second policy of the same name gets a number."""
    names: list[str] = []
    for policy in policies:
        name = Path(policy).stem if Path(policy).suffix or "/" in policy else policy
        count = sum(other == name or other.startswith(f"{name} (") for other in names)
        names.append(name if not count else f"{name} ({count + 1})")
    return names


def bounds_of(
    env: gymnasium.Env[Any, Any], seeds: Sequence[int], done: Callable[[], None] = lambda: None
) -> list[bound.LeastCost]:
    """The bound of each episode; ``done`` is called after every one."""
    limit = env.spec.max_episode_steps if env.spec is not None else None
    assert limit is not None, "an environment of the table ends"
    bounds = []
    for seed in seeds:
        env.reset(seed=seed)
        bounds.append(bound.least_cost(core_of(env), limit))
        done()
    return bounds


def write(evaluation: report.Evaluation, folder: Path, films: dict[str, Film]) -> list[Path]:
    """Write data, plots and films: all or none. Films that an earlier run made of the same controllers go."""
    names = [f"{one.name.replace(' ', '_')}{FILM}" for one in evaluation.played]
    with atomic.replacing_set(folder, parts=names) as new:
        atomic.write_text(new / DATA, json.dumps(report.as_data(evaluation), indent=1, allow_nan=False) + "\n")
        atomic.write_bytes(new / PICTURE, figures.png(plots.episodes(evaluation.played, evaluation.env)))
        for name, film in films.items():
            film.write(new / f"{name.replace(' ', '_')}{FILM}")
    return [folder / DATA, folder / PICTURE, *(folder / name for name in names if films)]


class FirstEpisode:
    """Films the first of many episodes."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        self.film = Film(env)
        self._episodes = 0

    def __call__(self, step: int) -> None:
        """As :class:`Film`."""
        self._episodes += step == 0
        if self._episodes == 1:
            self.film(step)
