"""Contact and its cost for the steady task's agent, in the training conditions and outside of them.

    tiago-mj train --env GripperTactileSteady-v0 --algo td3 --seeds 5 --out runs/steady
    python benchmarks/steady.py runs/steady [--episodes 50]

Every seed's last agent, its observations cut at those of its training, and both PI controllers play the same episodes,
of seeds that no training used, in each of SETTINGS. Writes ``results/learning_steady.json`` and two pictures beside it,
or, with ``--name``, of that name. PPO has no replay buffer to cut observations at: give ``--agent last``. Where the
training's reward was another than the task's, its curves are not drawn.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from learning_figures import Panel, dots
from machine import RESULTS, save

from tiago_mj.evaluate.metrics import Metrics, summarise
from tiago_mj.evaluate.play import play_policy
from tiago_mj.io import atomic
from tiago_mj.learn import plots
from tiago_mj.learn.agent_file import load_agent
from tiago_mj.learn.cut import cut, met
from tiago_mj.rollout.options import make_env
from tiago_mj.view import figures

NAME: Final = "learning_steady"
#: First seed of the episodes: those of training and of its evaluations are lower.
FIRST_SEED: Final = 900_000
CONTROLLERS: Final = ("pi", "pi-tuned")
#: What is drawn otherwise than in training; all of it lies outside of what training draws (in brackets).
SETTINGS: Final[Mapping[str, Mapping[str, Any]]] = {
    "as trained": {},
    "smaller goals": {"goal": [0.3, 0.5]},  # (0.5 to 1.5)
    "larger goals": {"goal": [1.5, 2.0]},
    "narrower": {"object_width": [0.02, 0.03]},  # (30 to 50 mm)
    "wider": {"object_width": [0.05, 0.06]},
    "farther to the right": {"object_offset": [-0.013, -0.008]},  # (8 mm to either side)
    "farther to the left": {"object_offset": [0.008, 0.013]},
    "softer": {"object_stiffness": [2000.0, 5000.0]},  # (5 to 15 kN/m)
    "stiffer": {"object_stiffness": [15000.0, 30000.0]},
    "heavier": {"object_mass": [0.6, 1.2]},  # (0.2 to 0.6 kg)
    "all of it": {
        "goal": [1.5, 2.0],
        "object_width": [0.05, 0.06],
        "object_offset": [0.008, 0.013],
        "object_stiffness": [2000.0, 5000.0],
    },
}
#: Of the metrics, what is kept.
KEPT: Final = (
    "reward",
    "paper_reward",
    "contact_share",
    "bounces",
    "rest_error",
    "overshoot",
    "object_shift",
    "success",
)
#: Options that shape the reward of a training: all are compared by the task's own.
SHAPING: Final = ("exponent", "weights")


def agent_files(card: Mapping[str, Any], folder: Path, kind: str, to: Path) -> dict[str, str]:
    """Name and file of every seed's agent; those that are cut are written to a folder."""
    files = {}
    for one in card["seeds"]:
        path = folder / f"seed-{one['seed']}" / f"{'last' if kind == 'cut' else kind}.npz"
        if kind == "cut":
            agent = load_agent(path)
            path = to / f"seed-{one['seed']}.npz"
            cut(agent, *met(folder / f"seed-{one['seed']}" / "checkpoint.zip", agent)).save(path)
        files[f"seed {one['seed']}"] = str(path)
    return files


def measured(card: Mapping[str, Any], agents: Mapping[str, str], episodes: int) -> dict[str, Any]:
    """Every agent and controller in every setting."""
    settings, seeds = card["settings"], range(FIRST_SEED, FIRST_SEED + episodes)
    policies = {**{name: name for name in CONTROLLERS}, **agents}
    own = {name: value for name, value in settings["env_options"].items() if name not in SHAPING}
    results = {}
    for name, options in SETTINGS.items():
        env = make_env(settings["env"], {**own, **options})
        try:
            rows = {
                label: row(play_policy(env, policy, name=label, seeds=seeds).metrics)
                for label, policy in policies.items()
            }
        finally:
            env.close()
        best = max(one["paper_reward"]["mean"] for one in rows.values())
        for one in rows.values():  # costs are positive: how much more this one pays
            one["behind_the_best"] = one["paper_reward"]["mean"] / best - 1
        results[name] = {"options": options, "rows": rows}
        print(line(name, rows), flush=True)
    return results


def row(metrics: Sequence[Metrics]) -> dict[str, Any]:
    """Mean and standard deviation of what is kept, and the episode with the least contact."""
    summary = {name: asdict(spread) for name, spread in summarise(metrics).items() if name in KEPT}
    shares = [0.0 if one.contact_share is None else one.contact_share for one in metrics]
    return {**summary, "least_contact": min(shares), "never_held": sum(one.contact_share is None for one in metrics)}


def line(name: str, rows: Mapping[str, Mapping[str, Any]]) -> str:
    """A setting: the controllers' costs, and the agents' range."""
    agents = [one for label, one in rows.items() if label.startswith("seed")]
    costs = [one["paper_reward"]["mean"] for one in agents]
    behind = [100 * one["behind_the_best"] for one in agents]
    shares = [100 * (one["contact_share"]["mean"] or 0.0) for one in agents]
    rest = [one["rest_error"]["mean"] for one in agents]
    pi = "".join(f"{rows[label]['paper_reward']['mean']:9.1f}" for label in CONTROLLERS)
    return (
        f"{name:22}{pi}  agents {min(costs):8.1f} to {max(costs):8.1f}, behind the best {min(behind):5.1f} to "
        f"{max(behind):5.1f} %, in contact {min(shares):6.2f} to {max(shares):6.2f} % (least "
        f"{100 * min(one['least_contact'] for one in agents):.1f}), bounces "
        f"{max(one['bounces']['mean'] or 0.0 for one in agents):.2f}, at rest {min(rest):.3f} to {max(rest):.3f}, "
        f"success {100 * min(one['success']['mean'] for one in agents):.0f} % or more"
    )


def picture(results: Mapping[str, Any]) -> Any:
    """How much more than the best each one pays, a panel a setting."""
    panels = []
    for name, one in results.items():
        rows = one["rows"]
        agents = [100 * row["behind_the_best"] for label, row in rows.items() if label.startswith("seed")]
        values = {"agents": agents} | {label: [100 * rows[label]["behind_the_best"]] for label in CONTROLLERS}
        panels.append(Panel(name, values))
    source = "Source: benchmarks/steady.py; the paper's reward, five seeds' agents. Dashed: 10 % behind the best."
    return dots(panels, "behind the best [%]", source, columns=4, line=10.0, wide=9.0)


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of a finished training")
    parser.add_argument("--episodes", type=int, default=50, help="in each setting")
    parser.add_argument("--agent", choices=("cut", "last", "best"), default="cut")
    parser.add_argument("--name", default=NAME, help="of the results")
    arguments = parser.parse_args()
    card = json.loads((arguments.folder / "card.json").read_text())
    with tempfile.TemporaryDirectory() as scratch:
        agents = agent_files(card, arguments.folder, arguments.agent, Path(scratch))
        settings = measured(card, agents, arguments.episodes)
    results = {
        "training": {name: card[name] for name in ("command", "made_by", "settings", "seeds")},
        "curves": json.loads((arguments.folder / "curves.json").read_text()),
        "agent": arguments.agent,
        "episodes": arguments.episodes,
        "settings": settings,
    }
    command = f"python benchmarks/steady.py RUN --episodes {arguments.episodes} --agent {arguments.agent}"
    command += "" if arguments.name == NAME else f" --name {arguments.name}"
    print(save(arguments.name, results, command).name)
    atomic.write_bytes(RESULTS / f"{arguments.name}.png", figures.png(picture(settings)))
    if set(SHAPING) & set(card["settings"]["env_options"]):
        return
    lines = [(name, settings["as trained"]["rows"][name]["reward"]["mean"]) for name in CONTROLLERS]
    atomic.write_bytes(
        RESULTS / f"{arguments.name}_curves.png", figures.png(plots.learning_curves(results["curves"], lines))
    )


if __name__ == "__main__":
    main()
