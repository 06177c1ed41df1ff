"""``tiago-mj train``: train agents on an environment, several seeds at once; the same command again goes on."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tiago_mj.effects import read_effects, written
from tiago_mj.io import atomic, extra, held
from tiago_mj.io.aligned import aligned
from tiago_mj.io.loading import load_yaml
from tiago_mj.io.numbers_option import with_numbers
from tiago_mj.learn import card, curves, duration, plots, progress, randomise
from tiago_mj.learn.loop import BEST, Task, train_seed
from tiago_mj.learn.settings import Settings, claim, provenance
from tiago_mj.learn.zoo_form import read_hyperparameters
from tiago_mj.randomisation import diagnosis
from tiago_mj.rollout import options, scale
from tiago_mj.view import figures


def run(arguments: argparse.Namespace) -> int:
    """Run the command.

    Raises:
        ValueError: an argument is unusable; says which and how to mend it.
        ModuleNotFoundError: a library is missing; says how to install it.
    """
    settings = settings_of(arguments)
    if settings.randomise is not None and not arguments.quiet:
        for line in randomise.told(settings.randomise):
            print(line, file=sys.stderr)
    if arguments.tensorboard:
        extra.load("tensorboard", "--tensorboard", "tensorboard")
    out = arguments.out.resolve()
    folders = [out / f"seed-{seed}" for seed in range(arguments.seeds)]
    left = sum(max(settings.steps - progress.steps(folder), 0) for folder in folders)
    here = arguments.backend == "local"  # what this machine can do says nothing of a cluster
    rate = _try_out(settings, measure=here and not arguments.quiet and left >= duration.SHORT)
    claim(out, settings)
    with held.alone(out, "training"):
        claim(out, settings)  # another process may have been quicker
        data, results = _train(arguments, settings, folders, left, rate)
    if arguments.json:
        print(json.dumps(data, indent=2))
        return 0
    print(table(results))
    chosen = arguments.out / f"seed-{data['best_seed']}" / BEST
    print(f"{settings.algo} on {settings.env}: card {arguments.out / 'card.md'}, best agent {chosen}")
    words = [f"{key}={json.dumps(value)}" for key, value in settings.env_options.items()]
    played = "".join(f" --env-option {shlex.quote(word)}" for word in words)
    print(f"next: tiago-mj rollout --env {arguments.env}{played} --policy {shlex.quote(str(chosen))} --episodes 10")
    return 0


def _train(
    arguments: argparse.Namespace, settings: Settings, folders: Sequence[Path], left: int, rate: float
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Train all unfinished seeds and write the card; returns its data and the result of each seed."""
    # On a cluster Ray ends the processes, and the lock of a seed whose machine is lost outlives them.
    starter, patience = (os.getpid(), None) if arguments.backend == "local" else (None, held.LEASE)
    tasks = [
        Task(settings, seed, str(folder), arguments.tensorboard, starter, patience)
        for seed, folder in enumerate(folders)
    ]
    jobs = arguments.jobs
    if jobs is None:  # more processes than processors share them evenly; waves of processes leave some idle at the end
        jobs = min(arguments.seeds, 2 * (os.cpu_count() or 1)) if arguments.backend == "local" else 0
    if rate:
        print(duration.said(rate, settings.steps, arguments.seeds, jobs or len(tasks), left), file=sys.stderr)
    with progress.shown(folders, settings.steps, quiet=arguments.quiet):
        results = scale.run_all(train_seed, tasks, jobs=jobs, backend=arguments.backend)
    return _conclude(arguments.out.resolve(), settings, results), results


def settings_of(arguments: argparse.Namespace) -> Settings:
    """The settings that the options ask for.

    Raises:
        ValueError: an option is unusable.
    """
    env = options.environment_id(arguments.env)
    counts = ("seeds", "evaluate_every", "evaluation_episodes", "checkpoint_every", "steps", "envs")
    options.check_least(arguments, 1, *counts)
    options.check_least(arguments, 0, "jobs")
    ratio = arguments.gradient_steps
    if ratio is not None and not 0 < ratio <= 100:
        raise ValueError(f"--gradient-steps is {ratio}: give updates per environment step, above 0, at most 100")
    given = read_hyperparameters(arguments.algo, env, arguments.hyperparameters)
    if ratio is not None and "train_freq" not in given and arguments.algo in ("ppo", "a2c"):
        raise ValueError(f"--gradient-steps is of algorithms with a replay buffer; {arguments.algo} has none")
    if arguments.envs is not None:
        given["n_envs"] = arguments.envs
    return Settings(
        env=env,
        algo=arguments.algo,
        steps=arguments.steps or given["n_timesteps"],
        env_options={**given["env_kwargs"], **options.read_options(arguments.env_option)},
        effects=_effects(arguments.effects, numbers=with_numbers(arguments)),
        hyperparameters=given,
        updates_per_step=ratio,
        evaluate_every=arguments.evaluate_every,
        evaluation_episodes=arguments.evaluation_episodes,
        checkpoint_every=arguments.checkpoint_every,
        randomise=_ranges(arguments.randomise),
    )


def table(results: Sequence[Mapping[str, Any]]) -> str:
    """One line a seed."""
    rows = [("seed", "best mean of 20", "at step", "evaluation", "success", "steps/s")]
    for result in results:
        best, speed = result["best_mean"], result["steps_per_second"]
        rows.append(
            (
                str(result["seed"]),
                "-" if best is None else f"{best:.2f}",
                str(result["best_steps"]),
                f"{result['mean_return']:.2f} ± {result['sd_return']:.2f}",
                f"{result['success_rate']:.2f}",
                "-" if speed is None else f"{speed:.0f}",
            )
        )
    return "\n".join(aligned(rows))


def _effects(path: Path | None, *, numbers: bool) -> Any:
    """The contents of a calibration, with or without its fitted numbers: what is trained must not change with the
    file."""
    if path is None:
        return None
    given = written.load(path)
    read_effects(given)  # complains of what it cannot use
    return given if numbers else written.without_numbers(given)


def _ranges(path: Path | None) -> Any:
    """What is drawn for every episode, checked."""
    if path is None:
        return None
    if not diagnosis.is_diagnosis(path):
        return randomise.read_ranges(load_yaml(path, f"--randomise {path} cannot be read"), f"--randomise {path}")
    try:
        return {randomise.POSTERIOR: diagnosis.read(path).as_data()}
    except ValueError as fault:
        raise ValueError(f"--randomise {path}: {fault}") from fault


def _try_out(settings: Settings, *, measure: bool) -> float:
    """Make one environment and a model, so that unusable settings are reported before anything is written.

    Returns:
        Environment steps a second of a seed; 0 where they are not measured.
    """
    # They take torch and stable-baselines3, which only a training needs.
    from tiago_mj.learn.build import make_model
    from tiago_mj.learn.environments import make_env

    env = make_env(settings, settings.hyperparameters["n_envs"])
    try:
        model = make_model(settings, env, 0)
        return duration.steps_per_second(model) if measure else 0.0
    finally:
        env.close()


def _conclude(out: Path, settings: Settings, results: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Write the curves and the card, all at once."""
    folders = [out / f"seed-{result['seed']}" for result in results]
    curve = curves.over_seeds([curves.read_episodes(folder) for folder in folders], settings.steps)
    data = card.card(settings, results, curve, provenance())
    drawn = {
        "env": settings.env,
        "algo": settings.algo,
        "seeds": len(results),
        "training": curve,
        "evaluation": curves.over_seeds([curves.read_evaluations(folder) for folder in folders], settings.steps),
    }
    with atomic.replacing_set(out) as new:
        curves.write_all(new, drawn)
        atomic.write_bytes(new / "curves.png", figures.png(plots.learning_curves(drawn)))
        atomic.write_text(new / "card.json", json.dumps(data, indent=1) + "\n")
        atomic.write_text(new / "card.md", card.markdown(data))
    return data
