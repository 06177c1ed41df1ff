"""Success rates of trained agents on the whole robot, Fetch's counterparts and the goal position.

    tiago-mj train --env TIAGoReach-v0 --algo her-td3 --seeds 3 --out runs/reach
    python benchmarks/every_robot.py reach=runs/reach [NAME=RUN ...] [--episodes 200]

Of every seed the best evaluated and the last agent play episodes that no training used, in the task as it is registered
(with the training's options where they change what is seen or asked, not how it is rewarded); beside them the
controllers that there are for it. ``success`` is that of an episode's last step, with its Wilson interval. For a force
to hold also the paper's reward, its distance from the bound of the gripper with the same object, and contact. Writes
each NAME into ``results/learning_every_robot.json``; the other names there stay.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from machine import RESULTS, machine, save
from scripted_experts import wilson

from tiago_mj.envs.flat import core_of
from tiago_mj.envs.hold_force import HoldForce
from tiago_mj.evaluate.command import bounds_of
from tiago_mj.evaluate.metrics import summarise
from tiago_mj.evaluate.play import play_policy
from tiago_mj.evaluate.report import distance_from_bound
from tiago_mj.rollout.options import make_env

NAME: Final = "learning_every_robot"
#: Of the episodes: neither a training nor the search for a recipe used these.
FIRST_SEED: Final = 920_000
AGENTS: Final = ("evaluated", "last")
#: Options of a training that say what it is rewarded for, and leave the task as it is.
REWARDED: Final = ("reward_type", "distance_threshold")
#: Of a force to hold.
HOLDING: Final = ("paper_reward", "rest_error", "bounces", "contact_share")


def measured(training: Path, episodes: int) -> dict[str, Any]:
    """Success of every seed's agents and of the controllers."""
    card = json.loads((training / "card.json").read_text())
    settings = card["settings"]
    options = {key: value for key, value in settings["env_options"].items() if key not in REWARDED}
    env = make_env(settings["env"], options)
    seeds = range(FIRST_SEED, FIRST_SEED + episodes)
    holds = isinstance(core_of(env), HoldForce)
    bounds = bounds_of(gripper(env, options), seeds) if holds else []

    def row(policy: str) -> dict[str, Any]:
        played = play_policy(env, policy, name=policy, seeds=seeds)
        spread = summarise(played.metrics)
        found: dict[str, Any] = {"success": spread["success"].mean, "return": asdict(spread["reward"])}
        found["ci95"] = wilson(sum(bool(one.success) for one in played.metrics), episodes)
        if holds:
            found |= {name: asdict(spread[name]) for name in HOLDING}
            found["below_the_bound"] = distance_from_bound(played, bounds)
        return found

    try:
        rows = []
        for one in card["seeds"]:
            folder = training / f"seed-{one['seed']}"
            agents = {name: row(str(folder / f"{name}.npz")) for name in AGENTS}
            lines = [line.split(",") for line in (folder / "evaluations.csv").read_text().splitlines()[1:]]
            curve = [[int(x[0]), float(x[1]), float(x[3])] for x in lines]
            rows.append({**one, **agents, "evaluations": curve})
        controllers = {name: row(name) for name in controllers_of(env)}
    finally:
        env.close()
    kept = {key: card[key] for key in ("command", "made_by", "settings")}
    return {**kept, "options": options, "episodes": episodes, "seeds": rows, "controllers": controllers}


def controllers_of(env: Any) -> tuple[str, ...]:
    """Names of what needs no training."""
    if isinstance(core_of(env), HoldForce):
        return ("pi", "pi-tuned")
    return ("scripted",) if hasattr(core_of(env), "workspace") else ()


def gripper(env: Any, options: dict[str, Any]) -> Any:
    """The same task for the gripper alone, whose bound is known."""
    return make_env(env.spec.id.replace("TIAGo", "Gripper"), options)


def table(name: str, result: dict[str, Any]) -> str:
    """A line for every agent and controller."""
    lines = [f"{name}: {result['settings']['env']}, {result['episodes']} episodes"]
    entries = [(f"{a} of seed {one['seed']}", one[a]) for one in result["seeds"] for a in AGENTS]
    for who, one in [*entries, *result["controllers"].items()]:
        low, high = one["ci95"]
        more = ""
        if "below_the_bound" in one:
            more = f", reward {one['paper_reward']['mean']:.2f}, {100 * one['below_the_bound']:.1f} % below the bound"
            if one["contact_share"]["mean"] is not None:
                more += f", in contact {100 * one['contact_share']['mean']:.1f} %"
        lines.append(f"  {who:24} success {one['success']:.3f} ({low:.3f} to {high:.3f}){more}")
    return "\n".join(lines)


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", help="NAME=FOLDER of a finished training")
    parser.add_argument("--episodes", type=int, default=200)
    arguments = parser.parse_args()
    path = RESULTS / f"{NAME}.json"
    results = json.loads(path.read_text())["results"] if path.exists() else {}
    for name, folder in (run.split("=", 1) for run in arguments.runs):
        results[name] = {**measured(Path(folder), arguments.episodes), "machine": machine()}
        print(table(name, results[name]))
    save(NAME, results, command=f"python benchmarks/every_robot.py NAME=RUN ... --episodes {arguments.episodes}")


if __name__ == "__main__":
    main()
