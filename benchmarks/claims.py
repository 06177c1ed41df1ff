"""The paper's claims as tables: the value of raw and binary forces, and the cost of controlling the whole robot.

    python benchmarks/claims.py DIR [--jobs 2]

trains VARIANTS by one recipe (the steady task's) and plays their last agents. The task is the steady one, which draws
goals and objects, its observation with finger positions, as the paper's has them. Compared is the paper's reward. DIR
keeps the trainings; the same command goes on where it stopped. Writes ``results/learning_claims.json`` and
``results/learning_claims.png``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import trainings
from learning_figures import courses
from machine import RESULTS, save

from tiago_mj.evaluate.metrics import summarise
from tiago_mj.evaluate.play import play_policy
from tiago_mj.io import atomic
from tiago_mj.learn import curves
from tiago_mj.models import names
from tiago_mj.rollout.options import make_env
from tiago_mj.view import figures

NAME: Final = "learning_claims"
ENV: Final = "GripperTactileSteady-v0"
TASK: Final[Mapping[str, Any]] = {"observe_fingers": True}
VARIANTS: Final[Mapping[str, Mapping[str, Any]]] = {
    "raw": {},
    "binary": {"force_type": "binary"},
    "none": {"force_type": "none"},
    "whole robot": {"robot": "tiago_ta11", "joints": list(names.TIAGO_JOINTS)},
}
#: First seed of the episodes that are compared: no training has used it.
FIRST_SEED: Final = 900_000
#: A training is there when its evaluations stay this close to the best one of all variants, as a share of it.
NEAR: Final = 0.1
KEPT: Final = ("reward", "paper_reward", "contact_share", "bounces", "rest_error", "overshoot", "object_shift")


def folder_of(name: str) -> str:
    """Of a variant's training."""
    return name.replace(" ", "-")


def measured(folder: Path, name: str, episodes: int) -> list[dict[str, Any]]:
    """Every seed's last agent, and how its training went."""
    training = folder / folder_of(name)
    card = json.loads((training / "card.json").read_text())
    env = make_env(f"tiago_mj/{ENV}", {**TASK, **VARIANTS[name]})
    rows = []
    try:
        for one in card["seeds"]:
            path = training / f"seed-{one['seed']}"
            seeds = range(FIRST_SEED, FIRST_SEED + episodes)
            metrics = play_policy(env, str(path / "last.npz"), name=name, seeds=seeds).metrics
            spread = {key: asdict(value) for key, value in summarise(metrics).items() if key in KEPT}
            steps, means = curves.read_evaluations(path)
            rows.append({
                **spread,
                "seed": one["seed"],
                "evaluations": {"steps": [int(s) for s in steps], "return": [float(m) for m in means]},
                "seconds_per_100k_steps": None if one["seconds"] is None else 1e5 * one["seconds"] / one["steps"],
            })  # fmt: skip
    finally:
        env.close()
    return rows


def add_arrival(results: Mapping[str, Sequence[dict[str, Any]]]) -> None:
    """To every row, ``there_from``: steps from which on evaluations stay near the best of all; None where they do not.

    The evaluations' episodes and reward are the same for all variants.
    """
    best = max(max(one["evaluations"]["return"]) for rows in results.values() for one in rows)
    for rows in results.values():
        for one in rows:
            steps, means = one["evaluations"]["steps"], one["evaluations"]["return"]
            far = [k for k, mean in enumerate(means) if mean < best - NEAR * abs(best)]
            first = far[-1] + 1 if far else 0
            one["there_from"] = steps[first] if first < len(steps) else None


def table(results: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """One line a variant and seed."""
    lines = [
        f"{'':16}{'paper reward':>14}{'at rest':>9}{'in contact':>12}{'shift [mm]':>12}{'from step':>11}{'s/1e5':>7}"
    ]
    for name, rows in results.items():
        for one in rows:
            share, rest = one["contact_share"]["mean"], one["rest_error"]["mean"]
            seconds = one["seconds_per_100k_steps"]
            lines.append(
                f"{name + ' ' + str(one['seed']):14}{one['paper_reward']['mean']:14.1f}{rest:9.3f}"
                f"{'-' if share is None else f'{100 * share:.1f} %':>12}{1e3 * one['object_shift']['mean']:12.2f}"
                f"{one['there_from'] or '-':>11}{'-' if seconds is None else f'{seconds:.0f}':>7}"
            )
    return "\n".join(lines)


def picture(results: Mapping[str, Sequence[Mapping[str, Any]]]) -> Any:
    """Evaluations during the trainings."""
    groups = {
        name: [(one["evaluations"]["steps"], one["evaluations"]["return"]) for one in rows]
        for name, rows in results.items()
    }
    return courses(
        groups, "return of an evaluation", f"Source: benchmarks/claims.py; {ENV}, one recipe, a line a seed."
    )


def main() -> None:
    """Train, play, print, write."""
    arguments = trainings.parser(__doc__, steps=80_000, seeds=2).parse_args()
    words = {folder_of(name): trainings.options({**TASK, **given}) for name, given in VARIANTS.items()}
    trainings.train(ENV, words, arguments)
    results = {name: measured(arguments.folder, name, arguments.episodes) for name in VARIANTS}
    add_arrival(results)
    print(table(results))
    about = {"task": TASK, "steps": arguments.steps, "episodes": arguments.episodes}
    command = f"python benchmarks/claims.py DIR --steps {arguments.steps} --seeds {arguments.seeds}"
    print(save(NAME, {**about, "variants": results}, command).name)
    atomic.write_bytes(RESULTS / f"{NAME}.png", figures.png(picture(results)))


if __name__ == "__main__":
    main()
