"""``tiago-mj record``: recordings of an environment or of any MJCF, as a real robot's would be."""

from __future__ import annotations

import argparse
import json
import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tiago_mj.effects import read_effects
from tiago_mj.io import atomic
from tiago_mj.io.loading import is_file, parse_json
from tiago_mj.io.numbers_option import with_numbers
from tiago_mj.io.progress import Progress
from tiago_mj.io.quoting import one_line, quoted
from tiago_mj.recordings.motions.play import Motion, read_motion
from tiago_mj.recordings.record import minari
from tiago_mj.recordings.record.environment import Plan, record
from tiago_mj.recordings.record.plain import ModelPlan, record_model
from tiago_mj.recordings.write import write_trial
from tiago_mj.robots import options as robots
from tiago_mj.rollout.options import environment_id
from tiago_mj.rollout.policies import make_policy


def run(arguments: argparse.Namespace) -> int:
    """Run the command.

    Raises:
        ValueError: an argument is unusable; says which and how to mend it.
    """
    for name, least in (("episodes", 1), ("seed", 0)):
        if getattr(arguments, name) < least:
            raise ValueError(f"--{name} is {getattr(arguments, name)}: give {least} or more")
    known = robots.said(arguments)
    arguments.model = known.model
    if arguments.model is None and known.facts:
        raise ValueError("--gains, --fix-base, --like and --tie are of a model: give --model or --robot, not --env")
    if arguments.minari is not None:
        if arguments.model is not None:
            raise ValueError("--minari is of --env: a plain model has no observations, actions and rewards")
        minari.check(arguments.minari)
    motion = None if arguments.motion is None else read_motion(arguments.motion)
    effects = parse_effects(arguments.effects, numbers=with_numbers(arguments))
    collected: list[minari.Collector] = []
    if arguments.model is not None:
        trials = _of_model(arguments, motion, effects, known)
    else:
        trials = _of_environment(arguments, motion, effects, collected)
    paths, written = [], None
    with Progress("record", quiet=arguments.json) as progress, atomic.replacing_set(arguments.out) as new:
        progress.stage("episodes", arguments.episodes)
        for trial in trials:
            paths.append(arguments.out / write_trial(trial, new).name)
            progress.advance()
        if collected:
            by = arguments.policy or arguments.motion.name
            written = minari.write(collected[0], arguments.minari, by)
    robot = arguments.model.name if arguments.model is not None else arguments.env
    if arguments.json:
        said = {"robot": robot, "recordings": [str(path) for path in paths]}
        print(json.dumps({**said, "minari": None if written is None else str(written)}, indent=1))
        return 0
    where = one_line(arguments.out)
    print(f"{len(paths)} recording{'s' if len(paths) > 1 else ''} of {robot} in {where}: {paths[0].name} ...")
    if written is not None:
        print(f"Minari dataset {one_line(arguments.minari)} in {one_line(written)}")
    print(f"next: tiago-mj diagnose {shlex.quote(str(arguments.out))} --out diagnosis")
    return 0


def parse_effects(given: Sequence[str] | None, *, numbers: bool = True) -> Any:
    """What ``--effects`` holds, each time that it is given: JSON, or the path of a calibration file; its fitted numbers
    only with ``numbers``.

    Raises:
        ValueError: it is neither.
    """
    if given is None:
        return None
    for text in map(str.strip, given):
        if text.startswith(("{", "[")):
            parse_json(text, "--effects is no JSON")
        elif not is_file(text):
            raise ValueError(f"--effects {quoted(text)}: neither JSON (a list or a mapping) nor a file")
    return list(read_effects([text.strip() for text in given], numbers=numbers))


def _of_environment(
    arguments: argparse.Namespace, motion: Motion | None, effects: Any, collected: list[minari.Collector]
) -> Any:
    if arguments.rate is not None:
        raise ValueError("--rate is of --model: give an environment its rate with --arguments '{\"control_hz\": 100}'")
    given = {} if arguments.arguments is None else parse_json(arguments.arguments, "--arguments is no JSON")
    if not isinstance(given, dict) or "effects" in given:
        raise ValueError("--arguments must be a JSON mapping of the environment's arguments; effects go to --effects")
    label = motion.name if motion is not None else Path(arguments.policy).stem

    def through(env: Any) -> Any:
        if arguments.minari is None:
            return env
        collected.append(minari.Collector(env))
        return collected[0]

    plan = Plan(environment_id(arguments.env), given, effects, motion, label)
    return record(
        plan,
        lambda env: make_policy(arguments.policy, env, seed=arguments.seed, trust=arguments.trust),
        episodes=arguments.episodes,
        seed=arguments.seed,
        through=through,
    )


def _of_model(arguments: argparse.Namespace, motion: Motion | None, effects: Any, said: robots.Said) -> Any:
    if motion is None and arguments.policy != "random":
        raise ValueError(f"--policy {arguments.policy} needs an environment: with --model give --motion, or random")
    if arguments.rate is not None and not 1 <= arguments.rate <= 10_000:
        raise ValueError(f"--rate is {arguments.rate}: give 1 to 10000 Hz")
    label = "random" if motion is None else motion.name
    robot = Path(os.path.relpath(arguments.model, arguments.out)).as_posix()
    facts = {key: value for key, value in said.facts.items() if key != "gains" or arguments.gains}
    plan = ModelPlan(arguments.model, motion, label, effects, arguments.rate, robot, facts)
    return record_model(plan, episodes=arguments.episodes, seed=arguments.seed)
