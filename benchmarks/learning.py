"""Results of a finished training: each seed's agents beside the PI controllers and the bound, and the learning
curves.

    tiago-mj train --env GripperTactile-v0 --algo td3 --seeds 5 --env-option servo=ideal --out runs/paper
    python benchmarks/learning.py runs/paper --name learning_paper_ideal [--episodes 20]

Per seed two agents: ``best``, the paper's choice (highest mean return of 20 successive training episodes, with their
exploration), and ``last``. All play the same episodes, of seeds that no training used, without exploration. Writes
``results/NAME.json`` and ``results/NAME.png``.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np
from machine import RESULTS, save

from tiago_mj.evaluate import bound, report
from tiago_mj.evaluate.command import bounds_of
from tiago_mj.evaluate.metrics import summarise
from tiago_mj.evaluate.play import Played, play_policy
from tiago_mj.io import atomic
from tiago_mj.learn import plots
from tiago_mj.rollout.options import make_env
from tiago_mj.view import figures

#: First seed of the episodes: those of training and of its evaluations are lower.
FIRST_SEED: Final = 900_000
AGENTS: Final = ("best", "last")
CONTROLLERS: Final = ("pi", "pi-tuned")


def measured(folder: Path, episodes: int) -> dict[str, Any]:
    """Every agent of a training and both controllers.

    Raises:
        ValueError: the training is not finished.
    """
    if not (folder / "card.json").exists():
        raise ValueError(f"{folder.name}/card.json is missing: finish the training first (the same command goes on)")
    card = json.loads((folder / "card.json").read_text())
    settings = card["settings"]
    seeds = range(FIRST_SEED, FIRST_SEED + episodes)
    env = make_env(settings["env"], settings["env_options"])
    try:
        played = [play_policy(env, name, name=name, seeds=seeds) for name in CONTROLLERS]
        for agent in AGENTS:
            for seed in card["seeds"]:
                path = folder / f"seed-{seed['seed']}" / f"{agent}.npz"
                played.append(play_policy(env, str(path), name=f"{agent} {seed['seed']}", seeds=seeds))
        bounds = bounds_of(env, seeds)
    finally:
        env.close()
    return {
        "training": {name: card[name] for name in ("command", "made_by", "settings", "seeds")},
        "curves": json.loads((folder / "curves.json").read_text()),
        "episodes": episodes,
        "bound": -float(np.mean([one.expected for one in bounds])),
        "controllers": {one.name: row(one, bounds) for one in played},
    }


def row(one: Played, bounds: list[bound.LeastCost]) -> dict[str, Any]:
    """A controller's metrics, mean and standard deviation, and its distance from the bound."""
    summary = {name: asdict(spread) for name, spread in summarise(one.metrics).items()}
    return {**summary, "distance_from_bound": report.distance_from_bound(one, bounds)}


def table(results: dict[str, Any]) -> str:
    """One line a controller."""
    lines = [f"{'':10}{'reward':>18}{'below the bound':>17}{'bounces':>9}{'in contact':>12}{'error at rest':>15}"]
    for name, one in results["controllers"].items():
        reward, share, rest = one["paper_reward"], one["contact_share"]["mean"], one["rest_error"]["mean"]
        bounces = one["bounces"]["mean"]
        lines.append(
            f"{name:10}{reward['mean']:10.2f} ± {reward['sd']:5.2f}{100 * one['distance_from_bound']:15.1f} %"
            f"{'-' if bounces is None else f'{bounces:.1f}':>9}{'-' if share is None else f'{100 * share:.1f} %':>12}"
            f"{rest:15.3f}"
        )
    return "\n".join([*lines, f"bound of the mean: {results['bound']:.2f}"])


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of a finished training")
    parser.add_argument("--name", required=True, help="of the results")
    parser.add_argument("--episodes", type=int, default=20)
    arguments = parser.parse_args()
    results = measured(arguments.folder, arguments.episodes)
    print(table(results))
    command = f"python benchmarks/learning.py RUN --name {arguments.name} --episodes {arguments.episodes}"
    print(save(arguments.name, results, command).name)
    lines = [(name, results["controllers"][name]["paper_reward"]["mean"]) for name in CONTROLLERS]
    picture = plots.learning_curves(results["curves"], [*lines, ("bound", results["bound"])])
    atomic.write_bytes(RESULTS / f"{arguments.name}.png", figures.png(picture))


if __name__ == "__main__":
    main()
