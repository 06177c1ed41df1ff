"""Every reader of files that users bring: how it is called, what it may raise, and valid input for it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any, Final

import hostile_files
import numpy as np

from fuzzing import seeds
from tiago_mj.models.convert.errors import ConversionError
from tiago_mj.recordings.recording import RecordingError


@dataclass(frozen=True)
class Target:
    """A reader.

    Attributes:
        write: makes a valid input below a folder.
        read: takes that folder; returns what was read.
        errors: that it may raise: these classes and no others.
        fixed: files of the input that are left as they are, by the ends of their names.
        share: how often it is tried, relative to the others.
        command: words of the command line that read the same, with ``{in}`` and ``{out}``; empty: there is none that
            is over soon.
    """

    write: Callable[[Path], None]
    read: Callable[[Path], Any]
    errors: tuple[type[BaseException], ...] = (RecordingError,)
    fixed: tuple[str, ...] = ()
    share: float = 1.0
    command: tuple[str, ...] = ()
    given: Mapping[str, Any] = field(default_factory=dict)


# How each is called --------------------------------------------------------------------------------------------------


def _recordings(folder: Path, map_file: str | None = None, within: str = "") -> Any:
    from tiago_mj.recordings.lint import inspect
    from tiago_mj.recordings.read import read_recordings

    result = read_recordings([folder / within], map_file=None if map_file is None else folder / map_file)
    return result, inspect(result.trials)


def _with_model(folder: Path) -> Any:
    from tiago_mj.gap.simulation.plant import plant_of
    from tiago_mj.recordings.lint import inspect_all
    from tiago_mj.recordings.read import read_recordings

    result = read_recordings([folder / "r"])
    plant = plant_of(result.trials)
    return inspect_all(result.trials, plant)


def _bag(name: str, folder: Path) -> Any:
    from tiago_mj.recordings.lint import inspect
    from tiago_mj.recordings.read import read_recordings

    result = read_recordings([folder / name], defaults={"robot": "arm.xml"})
    return result, inspect(result.trials)


def _motions(folder: Path) -> Any:
    from tiago_mj.recordings.motions.play import read_motion

    return [read_motion(folder / name).at(25) for name in ("m.csv", "y.yaml")]


def _one(name: str) -> Target:
    """A reader of one file of YAML or JSON."""
    reader = hostile_files.READERS[name]

    def write(folder: Path) -> None:
        reader.place(folder, reader.text(reader.content))

    def read(folder: Path) -> Any:
        found = reader.read(folder / reader.name)
        if name == "diagnosis":
            from tiago_mj.gap.report import json as report_json
            from tiago_mj.gap.report import terminal

            report_json.text(found)
            terminal.lines(found, {})
        return found

    return Target(write, read, (reader.error,))


def _agents(folder: Path) -> Any:
    from tiago_mj.learn.agent_file import load_agent

    seen = np.linspace(-3, 3, 10).astype(np.float32)
    found = [load_agent(path) for path in sorted(folder.glob("*.npz"))]
    acted = [agent(seen) for agent in found if agent.inputs == (("", 10),)]
    if not all(np.isfinite(action).all() for action in acted):
        raise AssertionError("an agent that was accepted acts with numbers that are not finite")
    return acted


@cache
def _tiny_model() -> Any:
    from tiago_mj.learn.build import make_model
    from tiago_mj.learn.environments import make_env

    settings = seeds.tiny_settings()
    return make_model(settings, make_env(settings, 1), 0)


def _write_checkpoint(folder: Path) -> None:
    from tiago_mj.learn import checkpoint

    model = _tiny_model()
    if model.replay_buffer.pos == 0:
        model.set_logger(_no_logger())
        model.learn(25)
    callbacks: dict[str, Any] = {"episodes": {"log": [[20, 1.0, True]], "best": None}, "evaluations": {"log": []}}
    own = {"best/low": np.zeros(2, np.float32)}
    checkpoint.write(folder / checkpoint.FILE, model, callbacks=callbacks, arrays=own, finished=False)


def _no_logger() -> Any:
    from stable_baselines3.common.logger import Logger

    return Logger(folder=None, output_formats=[])


def _checkpoint(folder: Path) -> Any:
    from tiago_mj.learn import checkpoint

    found = checkpoint.read(folder / checkpoint.FILE, _tiny_model())
    _tiny_model().__dict__.pop("_restored", None)
    return found


def _write_policy(folder: Path) -> None:
    _tiny_model().save(folder / "policy.zip", exclude=["replay_buffer_class", "_restored"])


def _policy(folder: Path) -> Any:
    """A file of stable-baselines3 that nobody trusts is refused, whatever is in it."""
    from tiago_mj.rollout.policies import make_policy

    made = make_policy(str(folder / "policy.zip"), None, seed=0, trust=False)  # type: ignore[arg-type]
    raise AssertionError(f"{made} was loaded without --trust")


def _write_run(folder: Path) -> None:
    """What ``tiago-mj train`` leaves, with numbers made up."""
    from tiago_mj.learn import card, curves, progress
    from tiago_mj.learn.settings import SCHEMA, provenance

    settings = seeds.tiny_settings()
    seed = folder / "seed-0"
    seed.mkdir(parents=True)
    agent = seeds.agent()
    agent.save(seed / "best.npz")
    agent.save(seed / "last.npz")
    log = [{"steps": k, "mean_return": 1.0, "sd_return": 0.1, "success_rate": 0.5} for k in (10, 60)]
    curves.write_seed(seed, [(20 * k, 1.0, True) for k in (1, 2, 3)], log)
    progress.report(seed, {"steps": 60, "mean": 1.0})
    result = {"seed": 0, "steps": 60, "seconds": 1.0, "steps_per_second": 60.0, "best_mean": 1.0, "best_steps": 60}
    result |= {key: value for key, value in log[-1].items() if key != "steps"}
    curve = curves.over_seeds([curves.read_episodes(seed)], 60)
    told = card.card(settings, [result], curve, dict.fromkeys(provenance(), "1"))
    seeds.put(folder, {"card.json": json.dumps(told)})
    seeds.put(folder, {"settings.json": json.dumps({"schema": SCHEMA, **settings.as_data(), "made_by": {}})})


def _run(folder: Path) -> Any:
    from tiago_mj.learn import curves, progress, settings, shipped

    said = settings.read(folder)
    left = max(said.steps - progress.steps(folder / "seed-0"), 0)
    seed = folder / "seed-0"
    drawn = [curves.over_seeds([read(seed)], said.steps) for read in (curves.read_episodes, curves.read_evaluations)]
    shipped.export(folder, "mine", folder / "exported")
    return left, drawn


def _convert(folder: Path) -> Any:
    from tiago_mj.models.convert.urdf_to_mjcf import convert

    return [convert(path, folder / f"{path.stem}.xml") for path in sorted(folder.glob("*.urdf"))]


def _write_urdf(kind: str, folder: Path) -> None:
    seeds.meshes(folder, (kind,))
    seeds.put(folder, {"robot.urdf": seeds.URDF.replace("MESH", f"part.{kind}")})


def _write_model(folder: Path) -> None:
    seeds.meshes(folder, ("stl", "obj"))
    seeds.put(folder, {**seeds.PARTS, "t.png": seeds.png(), "arm.xml": seeds.ARM})


def _models(folder: Path) -> Any:
    import mujoco

    from tiago_mj.models.bounded import load_model

    for name in ("arm.xml", "model.xml"):
        model = load_model(folder / name, f"model {name}")
        mujoco.mj_forward(model, mujoco.MjData(model))


def _import(kind: str, folder: Path, **options: Any) -> Any:
    """Import, write and lint, as the command does."""
    from tiago_mj.cli import import_
    from tiago_mj.recordings.imports import command

    words = ["import", kind, str(folder / options.pop("source", "")), "--out", str(folder / "out"), "--json"]
    for name, value in options.items():
        words += [f"--{name}"] if value is True else [f"--{name}", str(value).replace("{in}", str(folder))]
    import argparse

    parser = argparse.ArgumentParser()
    import_.add_arguments(parser)
    return command.run(parser.parse_args(words[1:]))


def _demo(folder: Path) -> Any:
    from tiago_mj.demo import arm_torque

    found = arm_torque.find(folder)
    return None if found is None else arm_torque.load(found)


def _options(folder: Path) -> Any:
    from tiago_mj.rollout.options import read_options

    text = (folder / "words.txt").read_text(encoding="utf-8", errors="surrogateescape")
    return read_options([line for line in text.splitlines() if line])


def _write_options(folder: Path) -> None:
    seeds.put(folder, {"words.txt": 'servo=ideal\ngoal=[0.5, 1.5]\nobject_offset=1e-3\nsensing={"noise": 0}\n'})


_EXPORT: Final = ("agents", "--export", "{in}", "--name", "mine", "--to", "{out}")
_CONVERT: Final = ("convert", "{in}/robot.urdf", "--out", "{out}/r.xml")
_IMPORT: Final = ("import",)
_OUT: Final = ("--out", "{out}")


def _importer(kind: str, write: Callable[[Path], None], share: float = 1.0, **options: Any) -> Target:
    words = [kind, "{in}/" + options.get("source", "") if options.get("source") else "{in}"]
    for name, value in options.items():
        if name != "source":
            words += [f"--{name}"] if value is True else [f"--{name}", str(value)]
    read = partial(_import, kind, **options)
    return Target(write, read, (RecordingError, ValueError), share=share, command=(*_IMPORT, *words, *_OUT))


TARGETS: Final[Mapping[str, Target]] = {
    **{name: _one(name) for name in hostile_files.READERS if name not in ("lerobot", "minari", "xl330")},
    "recordings csv": Target(seeds.recording_csv, _recordings, share=3),
    "recordings parquet": Target(seeds.recording_parquet, _recordings, share=3),
    "recordings mapped": Target(seeds.recording_mapped, partial(_recordings, map_file="map.yaml", within="a.csv")),
    "recordings with model": Target(
        seeds.recording_model, _with_model, share=2, command=("preflight", "{in}/r", "--json")
    ),
    "bag ros1": Target(seeds.bag("ros1"), partial(_bag, "grasp.bag"), share=0.15),
    "bag ros1 lz4": Target(seeds.bag("ros1", True), partial(_bag, "grasp.bag"), share=0.1),
    "bag sqlite3": Target(seeds.bag("sqlite3"), partial(_bag, "grasp"), share=0.1),
    "bag mcap": Target(seeds.bag("mcap"), partial(_bag, "grasp"), share=0.15),
    "bag mcap zstd": Target(seeds.bag("mcap", True), partial(_bag, "grasp"), share=0.15),
    "bag messages zstd": Target(seeds.bag("sqlite3", True), partial(_bag, "grasp"), share=0.1),
    "motions": Target(seeds.motion, _motions, (ValueError, RecordingError)),
    "agents": Target(seeds.agents, _agents, (ValueError,), share=1.5),
    "checkpoint": Target(_write_checkpoint, _checkpoint, (ValueError,), share=0.7),
    "policy zip": Target(_write_policy, _policy, (ValueError,), share=0.3),
    "training": Target(_write_run, _run, (ValueError,), command=_EXPORT),
    "urdf stl": Target(partial(_write_urdf, "stl"), _convert, (ConversionError,), share=0.5, command=_CONVERT),
    "urdf obj": Target(partial(_write_urdf, "obj"), _convert, (ConversionError,), share=0.3),
    "urdf dae": Target(partial(_write_urdf, "dae"), _convert, (ConversionError,), share=0.3),
    "urdf ply": Target(partial(_write_urdf, "ply"), _convert, (ConversionError,), share=0.3),
    "urdf glb": Target(partial(_write_urdf, "glb"), _convert, (ConversionError,), share=0.3),
    "urdf off": Target(partial(_write_urdf, "off"), _convert, (ConversionError,), share=0.3),
    "mjcf": Target(_write_model, _models, (ValueError,), share=1),
    "import xl330": _importer("xl330", seeds.xl330),
    "import so101": _importer("so101", seeds.so101, 0.7),
    "import so101 apart": _importer("so101", seeds.so101, 0.5, apart=True),
    "import ta11-curve": _importer("ta11-curve", seeds.ta11, 0.5, source="force.csv"),
    "import tiago-arm": _importer("tiago-arm", seeds.tiago_arm, 0.2),
    "import bag": _importer("bag", seeds.bag("mcap"), 0.1, source="grasp", robot="arm.xml"),
    "import lerobot 3": _importer("lerobot", seeds.lerobot("v3.0"), units="degrees"),
    "import lerobot 2": _importer("lerobot", seeds.lerobot("v2.1"), 0.7, units="degrees"),
    "import minari hdf5": _importer("minari", seeds.minari("hdf5"), map="{in}/map.yaml"),
    "import minari arrow": _importer("minari", seeds.minari("arrow"), 0.7, map="{in}/map.yaml"),
    "import minari parquet": _importer("minari", seeds.minari("parquet"), 0.7, map="{in}/map.yaml"),
    "demo arm": Target(seeds.demo_arm, _demo, (ValueError, RecordingError), share=0.5),
    "options": Target(_write_options, _options, (ValueError,), share=0.5),
}  # fmt: skip


def _write_motion(folder: Path) -> None:
    seeds.motion(folder)
    seeds.put(folder, {"arm.xml": seeds.ARM})


def _write_rest(folder: Path) -> None:
    """Two load cells that feel nothing."""
    rng = np.random.default_rng(0)
    table = {"time": np.arange(250) / 25, **{f"force.{side}": rng.normal(0, 0.01, 250) for side in ("right", "left")}}
    seeds.put(folder, {"rest.csv": seeds.csv_text(table)})


def _reads_nothing(folder: Path) -> None:
    raise AssertionError("this is tried through its command alone, which reads more than one file at once")


_SHORT: Final = ("--episodes", "1", "--env-option", "max_episode_steps=5")
#: What is only tried through the command line.
COMMANDS: Final[Mapping[str, Target]] = {
    "evaluate": Target(
        lambda folder: seeds.agent(6).save(folder / "plain.npz"),
        _reads_nothing,
        share=0.02,
        command=("evaluate", "--env", "GripperTactile-v0", "--policy", "{in}/plain.npz", *_SHORT, "--json"),
    ),
    "record": Target(
        _write_motion,
        _reads_nothing,
        share=0.15,
        command=("record", "--model", "{in}/arm.xml", "--motion", "{in}/m.csv", *_OUT),
    ),
    "calibrate-sensor": Target(
        _write_rest,
        _reads_nothing,
        share=0.15,
        command=("calibrate-sensor", "{in}", "--env", "GripperTactile-v0", "--out", "{out}/cell.yaml", "--json"),
    ),
}
