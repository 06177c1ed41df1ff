"""The commands that ``faults.py`` disturbs, with inputs of their own making, and how their outputs are compared."""

from __future__ import annotations

import hashlib
import json
import math
import re
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tiago_mj.io import held

HINGE = """<mujoco><option timestep="0.002"/><worldbody><body>
<joint name="hinge" axis="0 1 0" damping="0.05"/><geom size=".05" mass="0.1" pos="0 0 -.2"/></body></worldbody>
<actuator><position name="hinge" joint="hinge" kp="10" kv="0.3" ctrlrange="-1 1"/></actuator></mujoco>
"""
TRAINING = """GripperTactile-v0:
  n_timesteps: 600
  batch_size: 16
  policy_kwargs: "dict(net_arch=[16, 8])"
  train_freq: [1, episode]
  gradient_steps: 10
  learning_starts: 50
  hold: 7
  noise_type: normal
  noise_std: 0.1
  env_kwargs: {object_offset: 0.0}
"""
#: Of a motion [Hz].
RATE = 25
#: Keys of JSON that tell how long something took, or by which process.
TIMES = ("seconds", "steps_per_second", "process")
#: What a diagnosis goes on with until it is whole.
JOURNAL = "journal.jsonl"
#: What is no part of a result: locks, what is shown while a training runs, and what a killed run leaves to go on with.
APART = ("lock", "progress.json", JOURNAL)
#: In a stable-baselines3 model: JSON with the time of the start.
STARTED = "data"


@dataclass(frozen=True)
class Command:
    """A command with small inputs.

    Attributes:
        old, new: command lines for the folder that is named; the old one was there before. None: nothing was.
        together: files that appear together, where the rest grows until the command is over; empty: all of them.
        goes_on: options of the command after a kill.
    """

    old: Callable[[Path], list[str]] | None
    new: Callable[[Path], list[str]]
    together: tuple[str, ...] = ()
    goes_on: tuple[str, ...] = ()


def make_inputs(folder: Path, run: Callable[[list[str]], int]) -> dict[str, Command]:
    """Write the inputs into a folder; the commands by name."""
    from tiago_mj.effects import EFFECTS

    hinge, training = folder / "hinge.xml", folder / "training.yml"
    hinge.write_text(HINGE)
    training.write_text(TRAINING)
    recordings = []
    for name, faster in (("first", 1.0), ("second", 1.3)):
        recordings.append(folder / name)
        for k in range(3):
            motion = folder / f"motion-{k}.csv"
            motion.write_text(_motion(faster * (1 + 0.3 * k)))
            words = ["record", "--model", str(hinge), "--motion", str(motion), "--out", str(recordings[-1])]
            if run([*words, "--effects", '{"viscous_friction": {"damping": 0.05}}']):
                raise SystemExit("the inputs could not be recorded")
    few = ",".join(name for name in EFFECTS if name != "viscous_friction")

    def record(rate: int) -> Callable[[Path], list[str]]:
        words = ["record", "--model", str(hinge), "--policy", "random", "--episodes", "4", "--rate", str(rate)]
        return lambda out: [*words, "--out", str(out)]

    def evaluate(seed: int) -> Callable[[Path], list[str]]:
        words = ["evaluate", "--env", "GripperTactile-v0", "--policy", "pi", "--policy", "random", "--episodes", "2"]
        return lambda out: [*words, "--seed", str(seed), "--out", str(out)]

    def diagnose(which: int) -> Callable[[Path], list[str]]:
        return lambda out: [
            "diagnose", str(recordings[which]), "--model", str(hinge), "--without", few, "--jobs", "1",
            "--out", str(out),
        ]  # fmt: skip

    def diagnose_all(seed: int) -> Callable[[Path], list[str]]:
        return lambda out: [
            "diagnose-all", *map(str, recordings), "--model", str(hinge), "--without", few, "--jobs", "1",
            "--threads", "1", "--seed", str(seed), "--out", str(out),
        ]  # fmt: skip

    def train(seeds: int) -> Callable[[Path], list[str]]:
        return lambda out: [
            "train", "--env", "GripperTactile-v0", "--hyperparameters", str(training), "--quiet", "--env-option",
            "max_episode_steps=40", "--evaluate-every", "200", "--evaluation-episodes", "2", "--checkpoint-every",
            "200", "--jobs", "1", "--seeds", str(seeds), "--out", str(out),
        ]  # fmt: skip

    def blind(out: Path) -> list[str]:
        return [
            "blind", "--cases", "1", "--seed", "3", "--kinds", "one", "--settings", "plain", "--rates", "25",
            "--trials", "3", "--seconds", "1", "--jobs", "1", "--no-next-motion",
            "--diagnose-with", f"--without {few}", "--out", str(out),
        ]  # fmt: skip

    def curve(slope: int) -> Callable[[Path], list[str]]:
        return lambda out: ["import", "ta11-curve", "builtin", "--slope", str(slope), "--out", str(out)]

    return {
        "record": Command(record(50), record(100)),
        "import": Command(curve(300), curve(330)),
        "evaluate": Command(evaluate(5), evaluate(0)),
        "diagnose": Command(diagnose(1), diagnose(0), goes_on=("--resume",)),
        "diagnose-all": Command(diagnose_all(1), diagnose_all(0)),
        "train": Command(train(1), train(2), ("card.json", "card.md", "curves.json", "curves.png")),
        "blind": Command(None, blind, ("scores.json", "index.html")),
    }


def _motion(hertz: float) -> str:
    """A sine of two seconds with growing amplitude, for the hinge."""
    rows = [(k / RATE, 0.3 * k / RATE * math.sin(2 * math.pi * hertz * k / RATE)) for k in range(2 * RATE + 1)]
    return "time,command.hinge\n" + "".join(f"{time:.3f},{angle:.6f}\n" for time, angle in rows)


def digests(folder: Path, *, numbers: bool = True) -> dict[str, str]:
    """A digest of every file of a folder, by its path; what tells how long something took is left out.

    Hidden temporary files are none of it: the next run removes them, which is checked apart.

    Args:
        folder: of the files; empty where it is not there.
        numbers: whether numbers count in pages of text.

    Raises:
        ValueError: a file is no whole one of its kind.
    """
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.name not in APART and held.MARK not in str(path.relative_to(folder)):
            found[str(path.relative_to(folder))] = _digest(path, numbers)
    return found


def _digest(path: Path, numbers: bool) -> str:
    content = path.read_bytes()
    if path.suffix == ".json":
        content = json.dumps(_without_times(json.loads(content)), sort_keys=True).encode()
    elif path.suffix in (".npz", ".zip"):
        try:
            with zipfile.ZipFile(path) as packed:
                if packed.testzip() is not None:
                    raise ValueError(f"{path} is damaged")
                members = [(one.filename, one.CRC) for one in packed.infolist() if one.filename != STARTED]
        except zipfile.BadZipFile as fault:
            raise ValueError(f"{path} is cut off") from fault
        content = repr(sorted(members)).encode()
    elif path.suffix in (".html", ".md", ".yaml") and not numbers:
        content = re.sub(rb"\d[\d.,]*", b"#", content)
    return hashlib.sha256(content).hexdigest()


def _without_times(data: Any) -> Any:
    if isinstance(data, Mapping):
        return {key: _without_times(value) for key, value in data.items() if key not in TIMES}
    return [_without_times(value) for value in data] if isinstance(data, list) else data
