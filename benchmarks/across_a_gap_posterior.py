"""What to train in across a gap: ranges by hand, the posterior of a diagnosis, or the one repaired simulator.

    python benchmarks/across_a_gap_posterior.py DIR [--withheld EFFECT ...] [--arms ARM ...] [--seeds 5] [--jobs 1]

A withheld effect acts on the "real" gripper. The diagnosis is given ten recorded grasps of it and nothing else. PPO as
docs/learning.md prints it trains policies on the steady task, with the same recipe, steps and seeds in every arm:

    nominal     in the nominal simulator
    hand        under ranges by hand (HAND): the same for every withheld effect
    wide        under ranges by hand that hold every withheld effect (WIDE), as who knew of them would write them
    posterior   under ``--randomise`` of the diagnosis
    repaired    in the one simulator that the diagnosis repairs (``--effects calibration.yaml``)
    true        in the simulator with the true effect, which nobody has of a real robot: for reference

and every last agent plays the same episodes on the real gripper, with the task's own reward. DIR keeps recordings,
diagnoses and trainings; the same command goes on where it stopped. Writes ``results/across_a_gap_posterior.json`` and
``.png``. Differences are of a seed's mean return in two arms, with Student's 95 % intervals over the seeds that both
have, and of the means of all seeds, with Welch's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import across_a_gap as earlier
import numpy as np
import trainings
import yaml
from differences import LEVEL, difference
from learning_figures import Panel, dots
from machine import RESULTS, save
from scipy import stats

from tiago_mj.io import atomic
from tiago_mj.learn.agent_file import load_agent
from tiago_mj.randomisation import diagnosis
from tiago_mj.randomisation.posterior import described
from tiago_mj.vector.sb3 import make_sb3
from tiago_mj.view import figures

NAME: Final = "across_a_gap_posterior"
ENV: Final = earlier.ENV
#: By the effect's name. Of those that were tried, these are where a policy that was trained in the nominal simulator
#: returns less than one that was trained on the true effect (one seed each; docs/learning.md).
WITHHELD: Final[Mapping[str, Mapping[str, Mapping[str, float]]]] = {
    **{name: earlier.WITHHELD[name] for name in ("servo_stiffness", "force_bias")},
    "force_drift": {"force_drift": {"rate": 0.9}},
}
#: What an engineer writes who has no diagnosis. Of each number that the simulator has, from half to twice of it; of
#: what it lacks and people commonly vary, from nothing to the magnitude that docs/effects.md shows as clearly visible.
HAND: Final[Mapping[str, Mapping[str, Sequence[float]]]] = {
    "servo_stiffness": {"factor": [0.5, 2.0]},
    "servo_damping": {"damping": [0.0, 40.0]},
    "armature": {"mass": [0.0, 0.3]},
    "coulomb_friction": {"force": [0.0, 3.0]},
    "command_delay": {"seconds": [0.0, 0.03]},
    "contact_stiffness": {"factor": [0.5, 2.0]},
    "contact_damping": {"factor": [0.5, 2.0]},
    "contact_friction": {"factor": [0.5, 2.0]},
    "force_gain": {"factor": [0.5, 2.0]},
    "force_bias": {"offset": [-0.1, 0.1]},
}
#: The same, widened so that each withheld effect lies within.
WIDE: Final[Mapping[str, Mapping[str, Sequence[float]]]] = {
    **HAND,
    "servo_stiffness": {"factor": [0.25, 4.0]},
    "force_bias": {"offset": [-0.5, 0.5]},
    "force_drift": {"rate": [-1.0, 1.0]},
}
RANGES: Final = {"hand": HAND, "wide": WIDE}
#: Arms of which one training serves every withheld effect.
SHARED: Final = ("nominal", "hand", "wide")
ARMS: Final = ("nominal", "hand", "wide", "posterior", "repaired", "true")
#: What is told of the posterior arm beside others.
AGAINST: Final = ("hand", "wide", "repaired", "nominal")
#: Of the episodes that are compared: no training or recording has used them.
FIRST_SEED, EPISODES, STEPS_OF_ONE = earlier.FIRST_SEED, 100, 300


def folder_of(folder: Path, arm: str, name: str) -> Path:
    """Of an arm's training; one that does not depend on the effect serves all."""
    return folder / (arm if arm in SHARED else f"{arm}-{name}")


def train(folder: Path, withheld: Sequence[str], arguments: Any) -> None:
    """Train what is not trained yet, arm by arm."""
    rare = str(arguments.steps // 4)
    recipe = ["--algo", "ppo", "--evaluate-every", rare, "--checkpoint-every", rare]
    jobs = {}
    for arm in arguments.arms:
        for name in withheld:
            jobs[folder_of(folder, arm, name).name] = [*recipe, *_simulator(folder, arm, name)]
    trainings.train(ENV, jobs, arguments)


def _simulator(folder: Path, arm: str, name: str) -> list[str]:
    """Options of ``train`` that say what an arm is trained in."""
    found = folder / name / "diagnosis"
    if arm == "nominal":
        return []
    if arm in RANGES:
        atomic.write_text(folder / f"{arm}.yaml", yaml.safe_dump(RANGES[arm]))
        return ["--randomise", str(folder / f"{arm}.yaml")]
    if arm == "posterior":
        return ["--randomise", str(found)]
    if arm == "repaired":
        return ["--effects", str(found / "calibration.yaml")]
    return ["--effects", str(earlier.calibration(folder / name / "true.yaml", WITHHELD[name]))]


def played(path: Path, effect: Mapping[str, Any]) -> dict[str, float]:
    """Mean return and share of successes of an agent's episodes on a real gripper."""
    agent = load_agent(path)
    env = make_sb3(f"tiago_mj/{ENV}", EPISODES, seed=FIRST_SEED, threads=1, visual=False, effects=effect)
    try:
        observation, infos = env.reset(), []
        agent.reset()
        for _ in range(STEPS_OF_ONE):
            observation, _, _, infos = env.step(agent(observation))
    finally:
        env.close()
    return {
        "reward": float(np.mean([info["episode"]["r"] for info in infos])),
        "success": float(np.mean([info["is_success"] for info in infos])),
    }


def of_one(folder: Path, name: str, arms: Sequence[str], seeds: int) -> dict[str, Any]:
    """Every arm on the real gripper of one withheld effect, what the diagnosis said, and the differences; seeds whose
    training has not come to its end are left out."""
    effect, found = WITHHELD[name], folder / name / "diagnosis"
    rows = {}
    for arm in arms:
        agents = [folder_of(folder, arm, name) / f"seed-{seed}" / "last.npz" for seed in range(seeds)]
        rows[arm] = [played(path, effect) for path in agents if path.exists()]
    return {
        "effect": effect,
        "diagnosis": earlier.verdict(folder / name),
        "posterior": described(diagnosis.read(found)),
        "arms": rows,
        "posterior_minus": differences(rows),
    }


def differences(rows: Mapping[str, Sequence[Mapping[str, float]]]) -> dict[str, Any]:
    """Of the posterior arm from the others: over the seeds that both have, and of the means of all seeds."""
    ours = rows.get("posterior") or ()
    return {
        arm: {
            key: {
                "paired": paired([row[key] for row in ours], [row[key] for row in rows[arm]]),
                "all": unpaired([row[key] for row in ours], [row[key] for row in rows[arm]]),
            }
            for key in ("reward", "success")
        }
        for arm in AGAINST
        if ours and rows.get(arm)
    }


def unpaired(ours: Sequence[float], theirs: Sequence[float]) -> dict[str, Any]:
    """Difference of the means of two arms' seeds, and its 95 % interval by Welch's t; a seed gives two trainings in
    different simulators no more in common than that."""
    mean, counts = float(np.mean(ours) - np.mean(theirs)), [len(ours), len(theirs)]
    if min(counts) < 2:
        return {"seeds": counts, "mean": mean, "low": None, "high": None}
    parts = [float(np.var(one, ddof=1)) / len(one) for one in (ours, theirs)]
    error = sum(parts) ** 0.5
    if not error:
        return {"seeds": counts, "mean": mean, "low": mean, "high": mean}
    freedom = sum(parts) ** 2 / sum(part**2 / (count - 1) for part, count in zip(parts, counts, strict=True))
    half = float(stats.t.ppf(0.5 + LEVEL / 2, freedom)) * error
    return {"seeds": counts, "mean": mean, "low": mean - half, "high": mean + half}


def paired(ours: Sequence[float], theirs: Sequence[float]) -> dict[str, Any]:
    """Mean difference over the seeds that both have, with its interval where there are two at least."""
    both = min(len(ours), len(theirs))
    if both < 2:
        return {"seeds": both, "mean": ours[0] - theirs[0], "low": None, "high": None}
    return {"seeds": both, **difference(ours[:both], theirs[:both])}


def table(results: Mapping[str, Any]) -> str:
    """One line an arm of each real gripper, then the differences."""
    lines = []
    for name, one in results.items():
        lines.append(name)
        for arm, rows in one["arms"].items():
            if not rows:
                continue
            returns, wins = ([row[key] for row in rows] for key in ("reward", "success"))
            each = " ".join(f"{value:7.1f}" for value in returns)
            lines.append(f"  {arm:10} {np.mean(returns):7.1f}  ({each})  success {100 * np.mean(wins):3.0f} %")
        for arm, values in one["posterior_minus"].items():
            for how in ("paired", "all"):
                said = "  ".join(f"{key} {_with_interval(d[how])}" for key, d in values.items())
                lines.append(f"  posterior - {arm:9} {how:6} {said}")
    return "\n".join(lines)


def _with_interval(found: Mapping[str, Any]) -> str:
    ends = "one seed" if found["low"] is None else f"{found['low']:.3g} to {found['high']:.3g}, seeds {found['seeds']}"
    return f"{found['mean']:.3g} ({ends})"


def picture(results: Mapping[str, Any]) -> Any:
    """Returns of every arm on every real gripper."""
    panels = [
        Panel(name.replace("_", " "), {arm: [row["reward"] for row in rows] for arm, rows in one["arms"].items()})
        for name, one in results.items()
    ]
    source = f"Source: benchmarks/{NAME}.py; {ENV}, a dot a seed."
    return dots(panels, "return of an episode", source, columns=3, wide=9.0)


def main() -> None:
    """Record, diagnose, train, play, print, write."""
    parser = trainings.parser(__doc__, steps=400_000, seeds=5)
    parser.set_defaults(jobs=1, episodes=EPISODES)
    parser.add_argument("--withheld", nargs="+", choices=WITHHELD, default=list(WITHHELD), metavar="EFFECT")
    parser.add_argument("--arms", nargs="+", choices=ARMS, default=list(ARMS), metavar="ARM", help=", ".join(ARMS))
    parser.add_argument("--only-play", action="store_true", help="what is trained so far, and train nothing")
    arguments = parser.parse_args()
    folder, withheld = arguments.folder.resolve(), arguments.withheld
    arguments.folder = folder
    earlier.prepare(folder, {name: WITHHELD[name] for name in withheld}, arguments.jobs)
    if not arguments.only_play:
        train(folder, withheld, arguments)
    results = {name: of_one(folder, name, arguments.arms, arguments.seeds) for name in withheld}
    print(table(results))
    about = {"env": ENV, "steps": arguments.steps, "episodes": EPISODES, "ranges": RANGES}
    command = f"python benchmarks/{NAME}.py DIR --steps {arguments.steps} --seeds {arguments.seeds}"
    command += f" --withheld {' '.join(withheld)} --arms {' '.join(arguments.arms)}"
    print(save(NAME, {**about, "real": results}, command).name)
    atomic.write_bytes(RESULTS / f"{NAME}.png", figures.png(picture(results)))


if __name__ == "__main__":
    main()
