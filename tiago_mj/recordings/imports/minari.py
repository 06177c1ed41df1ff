"""Import of local Minari datasets: what was observed and done becomes what was measured and commanded.

A dataset of this package's environments says everything: which entries are joints, what an action commands, how often,
and with the seed of an episode its object. Of any other environment a map file says which number is what:

    columns:
      observations.0: position.slider
      observations.1: position.hinge
      actions.0: {kind: command, name: slide, scale: 100}
    rate_hz: 25
    interface: effort
    robot: cartpole.xml
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np

from tiago_mj.envs.flat import core_of
from tiago_mj.envs.hold_force import HoldForce
from tiago_mj.envs.hold_steady import HoldForceSteady
from tiago_mj.envs.position_goal import PositionGoal
from tiago_mj.io.quoting import quoted
from tiago_mj.models import names
from tiago_mj.recordings.imports.minari_folder import Dataset, Episode, open_dataset
from tiago_mj.recordings.read.columns import trial_from_table
from tiago_mj.recordings.read.mapping import FACTS, column_map, load_map
from tiago_mj.recordings.read.tables import Table
from tiago_mj.recordings.record.environment import episode_facts, sensing_facts, servo_facts
from tiago_mj.recordings.recording import SCHEMA, Array, Finding, RecordingError, Sidecar, Trial
from tiago_mj.recordings.usable import RATE, is_rate
from tiago_mj.registration import ENVIRONMENTS, NAMESPACE

#: Arguments of an environment in a dataset that are not a user's, or that the nominal simulator must not have.
_NOT_TAKEN: Final = ("task", "relative", "effects", "render_mode", "max_episode_steps")
#: Columns that are named where a map is asked for.
_NAMED: Final = 8


def read(source: str, *, map_file: Path | None, robot: str | None) -> tuple[list[Trial], list[Finding]]:
    """Trials of a dataset, one an episode, and what was found.

    Args:
        source: folder of the dataset.
        map_file: YAML: which number is what; None: it is of this package's environments.
        robot: environment id or MJCF, where the map file does not say.

    Raises:
        RecordingError: the folder is no such dataset or not whole, or nothing says what its numbers are.
    """
    dataset = open_dataset(source)
    if map_file is not None:
        return _mapped(dataset, map_file, robot)
    name, kwargs = dataset.environment or ("", {})
    short = name.removeprefix(f"{NAMESPACE}/")
    if short == name or short not in ENVIRONMENTS:
        first = next(dataset.episodes(), None)
        there = list(first.columns) if first is not None else []
        said = f"{', '.join(there[:_NAMED])}{' ...' if len(there) > _NAMED else ''}"
        raise RecordingError(
            f"{dataset.name}: its environment is {name or 'not named'}, none of this package's: say with --map which "
            f"of its {len(there)} columns are joints and commands ({said}), and rate_hz and interface"
        )
    arguments = {key: value for key, value in kwargs.items() if key not in _NOT_TAKEN}
    try:
        env: gymnasium.Env[Any, Any] = gymnasium.make(name, disable_env_checker=True, **arguments)
    except (TypeError, ValueError) as fault:
        raise RecordingError(
            f"{dataset.name}: its environment cannot be made ({' '.join(str(fault).split())}): say with --map which "
            "columns are what"
        ) from fault
    try:
        return [_trial(dataset, episode, env, arguments) for episode in dataset.episodes()], []
    finally:
        env.close()


def _mapped(dataset: Dataset, map_file: Path, robot: str | None) -> tuple[list[Trial], list[Finding]]:
    content = load_map(map_file)
    columns = column_map(content, map_file.name)
    rate = content.get("rate_hz")
    if not is_rate(rate):
        raise RecordingError(
            f"map file {map_file.name}: rate_hz is {quoted(rate)}: a Minari dataset has no stamps, so "
            f"of its steps: {RATE}"
        )
    if not columns:
        raise RecordingError(f"map file {map_file.name}: it names no column: write 'columns: {{actions.0: ...}}'")
    facts: dict[str, Any] = {key: content[key] for key in FACTS if key in content}
    trials: list[Trial] = []
    findings: dict[tuple[str, str], Finding] = {}
    for episode in dataset.episodes():
        missing = [column for column in columns if column not in episode.columns]
        if missing:
            raise RecordingError(
                f"map file {map_file.name}: {dataset.name} has no column {missing[0]!r}: it has "
                f"{', '.join(list(episode.columns)[:_NAMED])} ..."
            )
        table = {column: episode.columns[column] for column in columns}
        name = _name(episode)
        time = np.arange(len(next(iter(table.values())))) / float(rate)
        parts, found = trial_from_table(
            Table({"time": time, **table}, f"{name}.parquet", {}, f"map file {map_file.name}", {}),
            columns,
            {"robot": robot, **facts, "source": _source(dataset, episode)},
        )
        trials += parts
        for finding in found:
            findings.setdefault((finding.code, finding.channel), finding)
    return trials, list(findings.values())


def _trial(dataset: Dataset, episode: Episode, env: gymnasium.Env[Any, Any], arguments: Mapping[str, Any]) -> Trial:
    """An episode of this package's environments."""
    core = core_of(env)
    if isinstance(core, HoldForceSteady):
        raise RecordingError(
            f"{dataset.name}: observations of {dataset.environment and dataset.environment[0]} are scaled and hold not "
            "every joint: record them with tiago-mj record"
        )
    count = len(core.joints)
    seen = _vector(episode, "observations.observation" if core is env.unwrapped else "observations")
    actions = _vector(episode, "actions")
    if seen.shape[1] < 2 * count or actions.shape[1] != count:
        raise RecordingError(
            f"{dataset.name}: episode {episode.index} has {seen.shape[1]} observations and {actions.shape[1]} actions, "
            f"its environment has {count} joints: it was recorded through a wrapper; say with --map which is what"
        )
    env.reset(seed=episode.seed)
    facts = episode_facts(core)
    if episode.seed is None:
        facts = {"initial": {"set_point": facts["initial"]["set_point"]}}
    position, velocity = seen[:, :count], seen[:, count : 2 * count]
    for kind, rows in (("position", position), ("velocity", velocity)):
        facts["initial"][kind] = dict(zip(core.joints, rows[0].tolist(), strict=True))
    acted = np.clip(actions, -1.0, 1.0)
    commands = core.drive.command(acted, np.broadcast_to(core.data.act, (len(acted), len(core.data.act))))
    commands[np.isnan(actions)] = np.nan
    forces = _forces(episode, env, seen)
    name = _name(episode)

    def by(labels: tuple[str, ...], rows: Array) -> dict[str, Array]:
        return {label: np.ascontiguousarray(rows[:, k]) for k, label in enumerate(labels)}

    return Trial(
        name=name,
        time=np.arange(len(seen)) * core.dt,
        commands=by(core.joints, commands),
        positions=by(core.joints, position),
        velocities=by(core.joints, velocity),
        efforts={},
        forces={} if forces is None else by(names.SIDES, forces),
        sidecar=Sidecar(
            schema=SCHEMA,
            trial=name,
            robot=env.spec.id if env.spec else "",
            rate_hz=1 / core.dt,
            interface=core.control,
            servo=servo_facts(core),
            sensing=sensing_facts(core),
            motion={"dataset": dataset.name},
            source=_source(dataset, episode),
            raw={"arguments": dict(arguments)},
            **facts,
        ),
        source=f"{name}.parquet",
    )


def _forces(episode: Episode, env: gymnasium.Env[Any, Any], seen: Array) -> Array | None:
    """Load-cell readings, (T + 1, 2), from the infos or else the observations; None where neither has them."""
    core, count = core_of(env), len(names.SIDES)
    read_out = _vector(episode, "infos.force_raw")
    if read_out.shape[1] == count:
        return read_out
    observed = isinstance(core, (HoldForce, PositionGoal)) and core.force_type == "raw"
    if not observed or seen.shape[1] < 2 * len(core.joints) + count:
        return None
    last = seen[:, -count:]
    if core is env.unwrapped or isinstance(core, PositionGoal):
        return last
    return None if episode.seed is None else last + core.goal  # a flat view has them relative to the goal


def _vector(episode: Episode, name: str) -> Array:
    """Columns ``name.0``, ``name.1`` ... side by side, (T + 1, n); (T + 1, 0) where there are none."""
    count = 0
    while f"{name}.{count}" in episode.columns:
        count += 1
    rows = len(next(iter(episode.columns.values())))
    found = [episode.columns[f"{name}.{k}"] for k in range(count)]
    return np.stack(found, axis=1) if found else np.zeros((rows, 0))


def _name(episode: Episode) -> str:
    return f"episode_{episode.index:06d}"


def _source(dataset: Dataset, episode: Episode) -> dict[str, Any]:
    return {"format": "Minari", "dataset": dataset.name, "episode": episode.index, "seed": episode.seed}
