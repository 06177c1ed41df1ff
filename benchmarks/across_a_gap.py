"""Value of a diagnosis for training: returns of policies across a gap whose cause is withheld from them.

    python benchmarks/across_a_gap.py DIR [--withheld EFFECT ...] [--hyperparameters FILE] [--agent last] [--jobs 2]

A withheld effect acts on the "real" gripper. Four policies are trained by the same recipe, on the steady task:

    A  on the nominal simulator
    B  on the simulator that ``tiago-mj diagnose`` calibrates with ten recorded grasps of the real gripper
    C  under domain randomisation: every episode draws its simulator from wide ranges (RANGES)
    D  on the true effect

and all are played on the real one. The diagnosis is a process of its own and is given the recordings, nothing else.
DIR keeps recordings, diagnoses and trainings; the same command goes on where it stopped. Writes ``results/NAME.json``
and ``results/NAME.png``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np
import trainings
import yaml
from learning_figures import Panel, dots
from machine import RESULTS, save

from tiago_mj.evaluate.metrics import summarise
from tiago_mj.evaluate.play import play_policy
from tiago_mj.io import atomic
from tiago_mj.rollout.options import make_env
from tiago_mj.view import figures

ENV: Final = "GripperTactileSteady-v0"
#: What is withheld: of the stages command, actuator and force sensor.
WITHHELD: Final[Mapping[str, Mapping[str, Mapping[str, float]]]] = {
    "servo_stiffness": {"servo_stiffness": {"factor": 4.0}},
    "command_delay": {"command_delay": {"seconds": 0.0125}},
    "force_gain": {"force_gain": {"factor": 2.5}},
    "rate_limit": {"rate_limit": {"velocity": 0.06}},
    "force_bias": {"force_bias": {"offset": 0.5}},
    "armature": {"armature": {"mass": 4.0}},
}
#: For C: what a person might vary who does not know which number is wrong.
RANGES: Final[Mapping[str, Mapping[str, Sequence[float]]]] = {
    "command_delay": {"seconds": [0.0, 0.04]},
    "servo_stiffness": {"factor": [0.5, 2.0]},
    "servo_damping": {"damping": [0.0, 80.0]},
    "velocity_limit": {"velocity": [0.05, 0.08]},
    "coulomb_friction": {"force": [0.0, 2.0]},
    "contact_stiffness": {"factor": [0.5, 2.0]},
    "contact_damping": {"factor": [0.5, 1.5]},
    "force_gain": {"factor": [0.4, 2.5]},
}
#: Grasps of the real gripper that the diagnosis is given, with the object off the middle by the environment's default.
RECORDINGS: Final = 10
#: First seed of the episodes that are compared: no training or recording has used it.
FIRST_SEED: Final = 900_000


def trained(folder: Path, withheld: Sequence[str], recipe: Sequence[str]) -> dict[str, list[str]]:
    """Of every training its name and options, in the order in which they are worth most."""
    jobs = {}
    for name in withheld:
        effect = WITHHELD[name]
        jobs[f"D-{name}"] = ["--effects", str(calibration(folder / name / "true.yaml", effect))]
        jobs[f"B-{name}"] = ["--effects", str(folder / name / "diagnosis" / "calibration.yaml")]
    ranges = folder / "ranges.yaml"
    atomic.write_text(ranges, yaml.safe_dump(RANGES))
    jobs = {"A": [], "C": ["--randomise", str(ranges)], **jobs}
    return {name: [*recipe, *more] for name, more in jobs.items()}


def prepare(folder: Path, withheld: Mapping[str, Mapping[str, Mapping[str, float]]], jobs: int) -> None:
    """Record the real grippers, by the names of their folders, and diagnose them, where that is not done."""
    for name, effect in withheld.items():
        here = folder / name
        if not any((here / "recordings").glob("*.parquet")):
            command = ["record", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", str(RECORDINGS)]
            trainings.tiago_mj(*command, "--effects", json.dumps(effect), "--out", str(here / "recordings"))
        diagnosis = here / "diagnosis"
        if not (diagnosis / "calibration.yaml").exists():
            trainings.tiago_mj("diagnose", str(here / "recordings"), "--out", str(diagnosis), "--jobs", str(jobs))


def played(folder: Path, withheld: Sequence[str], agent: str, episodes: int, seeds: int) -> dict[str, Any]:
    """Every policy on every real gripper, and on the nominal one."""
    results: dict[str, Any] = {}
    for name in ("nominal", *withheld):
        effect = WITHHELD.get(name, {})
        env = make_env(f"tiago_mj/{ENV}", {"effects": effect})
        try:
            rows = {}
            for letter in "ABCD":
                training = folder / (letter if letter in "AC" else f"{letter}-{name}")
                if training.exists():
                    paths = [str(training / f"seed-{seed}" / f"{agent}.npz") for seed in range(seeds)]
                    rows[letter] = [one_policy(env, path, episodes) for path in paths]
            rows["pi"] = [one_policy(env, "pi", episodes)]
        finally:
            env.close()
        results[name] = {"effect": effect, "policies": rows}
        if "D" in rows:
            results[name] |= {"recovered": {x: recovered(rows, x) for x in "BC"}, "diagnosis": verdict(folder / name)}
    return results


def one_policy(env: Any, policy: str, episodes: int) -> dict[str, Any]:
    """Mean and standard deviation of the metrics that are told."""
    metrics = play_policy(env, policy, name=policy, seeds=range(FIRST_SEED, FIRST_SEED + episodes)).metrics
    wanted = ("reward", "paper_reward", "contact_share", "bounces", "rest_error")
    return {name: asdict(spread) for name, spread in summarise(metrics).items() if name in wanted}


def recovered(rows: Mapping[str, Sequence[Mapping[str, Any]]], letter: str) -> float | None:
    """Share of the way from A to D, in means of the seeds; None unless every seed of D is better than all of A."""
    returns = {x: [row["reward"]["mean"] for row in rows[x]] for x in ("A", letter, "D")}
    if min(returns["D"]) <= max(returns["A"]):
        return None
    means = {x: float(np.mean(values)) for x, values in returns.items()}
    return (means[letter] - means["A"]) / (means["D"] - means["A"])


def verdict(folder: Path) -> dict[str, Any]:
    """What the diagnosis said: its word, and the effects of its calibration."""
    diagnosis = json.loads((folder / "diagnosis" / "diagnosis.json").read_text())
    calibration = yaml.safe_load((folder / "diagnosis" / "calibration.yaml").read_text())
    said = {key: diagnosis["verdict"][key] for key in ("kind", "effects", "probability")}
    return {"verdict": said, "calibration": calibration["effects"]}


def calibration(path: Path, effect: Mapping[str, Mapping[str, float]]) -> Path:
    """Write an effect as a calibration, and say where."""
    effects = [{"name": name, "parameters": dict(parameters)} for name, parameters in effect.items()]
    atomic.write_text(path, yaml.safe_dump({"schema": "tiago_mj.calibration/1", "effects": effects}))
    return path


def table(results: Mapping[str, Any]) -> str:
    """One line a real gripper."""
    lines = [f"{'':16}" + "".join(f"{letter:>20}" for letter in ("A", "B", "C", "D")) + f"{'PI':>10}{'B':>7}{'C':>7}"]
    for name, one in results.items():
        cells = []
        for letter in "ABCD":
            rows = one["policies"].get(letter, [])
            cells.append(" / ".join(f"{row['reward']['mean']:.0f}" for row in rows))
        shares = ""
        for x in "BC":
            share = one.get("recovered", {}).get(x)
            shares += f"{'-':>7}" if share is None else f"{100 * share:6.0f}%"
        pi = one["policies"]["pi"][0]["reward"]["mean"]
        lines.append(f"{name:16}" + "".join(f"{cell:>20}" for cell in cells) + f"{pi:10.0f}{shares}")
    return "\n".join(lines)


def picture(results: Mapping[str, Any]) -> Any:
    """Returns of every policy on every real gripper."""
    names = {
        "A": "A: nominal",
        "B": "B: calibrated",
        "C": "C: randomised",
        "D": "D: true effect",
        "pi": "PI controller",
    }
    panels = []
    for name, one in results.items():
        rows = one["policies"]
        values = {label: [row["reward"]["mean"] for row in rows.get(x, [])] for x, label in names.items()}
        panels.append(Panel(name.replace("_", " "), values))
    source = f"Source: benchmarks/across_a_gap.py; {ENV}, a dot a seed."
    return dots(panels, "return of an episode", source, columns=2)


def main() -> None:
    """Record, diagnose, train, play, print, write."""
    parser = trainings.parser(__doc__, steps=100_000, seeds=2)
    parser.add_argument("--withheld", nargs="+", choices=WITHHELD, default=list(WITHHELD), metavar="EFFECT")
    parser.add_argument("--hyperparameters", type=Path, help="of all trainings (those that are shipped)")
    parser.add_argument("--agent", choices=("last", "evaluated"), default="last", help="of each training")
    parser.add_argument("--name", default="across_a_gap", help="of the results")
    arguments = parser.parse_args()
    folder, withheld, agent = arguments.folder.resolve(), arguments.withheld, arguments.agent
    recipe = ["--evaluate-every", "2000"] if agent == "evaluated" else []
    if arguments.hyperparameters is not None:
        recipe += ["--hyperparameters", str(arguments.hyperparameters)]
    prepare(folder, {name: WITHHELD[name] for name in withheld}, arguments.jobs)
    arguments.folder = folder
    trainings.train(ENV, trained(folder, withheld, recipe), arguments)
    results = played(folder, withheld, agent, arguments.episodes, arguments.seeds)
    print(table(results))
    about = {"env": ENV, "steps": arguments.steps, "episodes": arguments.episodes, "agent": agent, "ranges": RANGES}
    command = f"python benchmarks/across_a_gap.py DIR --steps {arguments.steps} --episodes {arguments.episodes}"
    command += f" --withheld {' '.join(withheld)} --agent {agent} --name {arguments.name}"
    if arguments.hyperparameters is not None:
        command += f" --hyperparameters benchmarks/{arguments.hyperparameters.name}"
    print(save(arguments.name, {**about, "real": results}, command).name)
    atomic.write_bytes(RESULTS / f"{arguments.name}.png", figures.png(picture(results)))


if __name__ == "__main__":
    main()
