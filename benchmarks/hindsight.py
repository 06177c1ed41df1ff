"""The success rate that hindsight replay reaches on a goal environment.

    tiago-mj train --env GripperTactileGoal-v0 --algo her-td3 --out runs/her
    python benchmarks/hindsight.py runs/her [runs/another ...]

The best, the best evaluated and the last agent of every seed play episodes that no training used; success is that of
an episode's last step. Writes ``results/learning_hindsight.json``.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any, Final

from machine import save

from tiago_mj.evaluate.metrics import summarise
from tiago_mj.evaluate.play import play_policy
from tiago_mj.rollout.options import make_env

FIRST_SEED: Final = 900_000
#: Of trainings that were made before there was one, the best evaluated is missing.
AGENTS: Final = ("best", "evaluated", "last")


def measured(training: Path, episodes: int) -> dict[str, Any]:
    """Success of the agents, and of the evaluations during the training."""
    card = json.loads((training / "card.json").read_text())
    env = make_env(card["settings"]["env"], card["settings"]["env_options"])
    seeds = range(FIRST_SEED, FIRST_SEED + episodes)
    rows = []
    try:
        for one in card["seeds"]:
            folder = training / f"seed-{one['seed']}"
            lines = [line.split(",") for line in (folder / "evaluations.csv").read_text().splitlines()[1:]]
            row: dict[str, Any] = {"seed": one["seed"], "evaluations": [[int(x[0]), float(x[3])] for x in lines]}
            for agent in (name for name in AGENTS if (folder / f"{name}.npz").exists()):
                played = play_policy(env, str(folder / f"{agent}.npz"), name=agent, seeds=seeds)
                row[agent] = {"success": summarise(played.metrics)["success"].mean}
            rows.append({**row, "best_steps": one["best_steps"]})
    finally:
        env.close()
    return {"command": card["command"], "made_by": card["made_by"], "settings": card["settings"], "seeds": rows}


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, help="of finished trainings")
    parser.add_argument("--episodes", type=int, default=100)
    arguments = parser.parse_args()
    results = {}
    for folder in arguments.folders:
        one = measured(folder, arguments.episodes)
        normalised = ", normalised" if one["settings"]["hyperparameters"]["normalize"] else ""
        drawn = ", goals drawn" if isinstance(one["settings"]["env_options"].get("goal"), list) else ""
        results[one["settings"]["env"] + normalised + drawn] = one
        for row in one["seeds"]:
            course = ", ".join(f"{steps}: {100 * rate:.0f} %" for steps, rate in row["evaluations"])
            print(
                f"{one['settings']['env']} seed {row['seed']}: best ({row['best_steps']} steps) "
                f"{100 * row['best']['success']:.0f} %, last {100 * row['last']['success']:.0f} %; {course}"
            )
    command = (
        f"python benchmarks/hindsight.py {' '.join('RUN' for _ in arguments.folders)} --episodes {arguments.episodes}"
    )
    print(save("learning_hindsight", results, command).name)


if __name__ == "__main__":
    main()
