"""``tiago-mj cost``: which effect of a diagnosis costs a policy most, and is to be mended first."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from tiago_mj.effects import Entry, read_effects, written
from tiago_mj.export.found import calibration_file
from tiago_mj.io.numbers_option import with_numbers
from tiago_mj.io.progress import Progress
from tiago_mj.io.quantities import fixed
from tiago_mj.io.quoting import quoted
from tiago_mj.policy_cost import doubts, report, rollouts
from tiago_mj.policy_cost.effect_costs import Plan, costs
from tiago_mj.policy_cost.magnitudes import items_of
from tiago_mj.policy_cost.play import Outcome, play
from tiago_mj.recordings.robot import MODELS
from tiago_mj.rollout import options, scale
from tiago_mj.rollout.episode import Policy
from tiago_mj.rollout.policies import RANDOM, absolute, make_policy


@dataclass(frozen=True)
class Simulator:
    """One simulator, and the episodes that are played in it.

    Attributes:
        env: id, with its namespace; of the rollouts, where the recordings do not say.
        env_options: its arguments, as JSON.
        policy: name or file; None: logged actions are sent again.
        trust: whether files may be unpickled.
        seeds: of the episodes.
        logged: files and folders of rollouts, whose conditions the episodes have; none: the environment draws them.
        effects: beside the nominal model.
    """

    env: str | None
    env_options: str
    policy: str | None
    trust: bool
    seeds: tuple[int, ...]
    logged: tuple[str, ...]
    effects: tuple[Entry, ...]


def run(arguments: argparse.Namespace) -> int:
    """Run the command.

    Raises:
        ValueError: an argument is unusable; says which and how to mend it.
    """
    options.check_least(arguments, 1, "draws")
    if arguments.policy is None and not arguments.rollouts:
        raise ValueError("nothing says who acts: give --policy, or --rollouts with logged actions")
    file = calibration_file(arguments.diagnosis)
    items, result = items_of(file, numbers=with_numbers(arguments)), doubts.result_of(file)
    plan = Plan.of(items, arguments.draws, arguments.seed, doubts.others_of(result, items))
    one = _simulator(arguments, file)
    logged = _logged(one.logged, one.env) if one.logged else None

    def simulate(simulators: Sequence[tuple[Entry, ...]]) -> Sequence[Sequence[Outcome]]:
        tasks = [replace(one, effects=effects) for effects in simulators]
        with Progress("cost", quiet=arguments.json) as progress:
            progress.stage("simulators", len(tasks))
            return scale.run_all(
                play_simulator,
                tasks,
                jobs=arguments.jobs,
                backend=arguments.backend,
                done=lambda task: progress.advance(),
            )

    found = costs(plan, simulate)
    robot = one.env if logged is None else logged.plant.name
    measured = _measured(logged)
    notes = [report.MEND if one.policy is not None else report.OPEN_LOOP, *doubts.sentences(result)]
    if measured is not None:
        notes.append(f"Measured return of the rollouts: {fixed(measured, report.decimals_of(found))}, their mean.")
    if arguments.json:
        about = {"env": robot, "env_options": json.loads(one.env_options), "policy": arguments.policy}
        about |= {"rollouts": [str(path) for path in arguments.rollouts], "seed": arguments.seed}
        about["measured_return"] = measured
        print(json.dumps(report.as_data(found, about, notes), indent=1, allow_nan=False))
        return 0
    who = "logged actions" if one.policy is None else f"policy {arguments.policy}"
    print(report.text(found, f"{who} in {robot}", notes))
    return 0


def _simulator(arguments: argparse.Namespace, file: Path) -> Simulator:
    """The nominal simulator, checked as far as it can be without playing."""
    said = written.load(file)
    robot = str(said.get("robot") or "") if isinstance(said, dict) else ""
    name = arguments.env or (robot if robot and not arguments.rollouts else None)
    if name is None and not arguments.rollouts:
        raise ValueError(f"{file} does not say of which robot it is: give --env ID")
    if name is not None and name.endswith(MODELS):
        raise ValueError(
            f"the diagnosis is of {quoted(name)}, and a return needs a task with rewards: give --env ID, or call "
            "tiago_mj.policy_cost.cost in Python with an environment of your own"
        )
    given = options.read_options(arguments.env_option)
    if arguments.rollouts and given:
        raise ValueError("--env-option and --rollouts: the logged rollouts say what the environment is: leave one out")
    policy = None if arguments.policy is None else absolute(arguments.policy)
    one = Simulator(
        env=None if name is None else options.environment_id(name),
        env_options=json.dumps(given, sort_keys=True),
        policy=policy,
        trust=arguments.trust,
        seeds=options.seeds_of(arguments),
        logged=tuple(str(path.resolve()) for path in arguments.rollouts),
        effects=(),
    )
    if policy is not None:
        _policy(one, one.seeds[0])
    return one


def play_simulator(one: Simulator) -> list[Outcome]:
    """All episodes in one simulator; an episode depends on its seed and on no other episode."""
    if one.logged:
        policy = None if one.policy is None else _policy(one, one.seeds[0])
        return rollouts.simulate(_logged(one.logged, one.env), one.effects, policy, seed=one.seeds[0])
    given = json.loads(one.env_options)
    effects = [*read_effects(given.pop("effects", None)), *one.effects]
    env = options.make_env(str(one.env), {"visual": False, **given, "effects": effects or None})
    try:
        return [play(env, _policy(one, seed), seed) for seed in one.seeds]
    finally:
        env.close()


def _policy(one: Simulator, seed: int) -> Policy:
    """The policy; made once in each process for the nominal environment, as whoever made it knew no effects."""
    assert one.policy is not None
    return _made(replace(one, effects=(), seeds=(seed,) if one.policy == RANDOM else one.seeds[:1]))


@lru_cache(maxsize=1)
def _made(one: Simulator) -> Policy:
    if one.logged:
        env = rollouts.nominal_env(_logged(one.logged, one.env))
    else:
        env = options.make_env(str(one.env), json.loads(one.env_options))
    assert one.policy is not None
    try:
        return make_policy(one.policy, env, seed=one.seeds[0], trust=one.trust)
    finally:
        env.close()


@lru_cache(maxsize=1)
def _logged(paths: tuple[str, ...], env: str | None) -> rollouts.Rollouts:
    return rollouts.read([Path(path) for path in paths], env)


def _measured(logged: rollouts.Rollouts | None) -> float | None:
    """Mean return of the rollouts as they were measured; None where one is not known."""
    returns = [] if logged is None else logged.measured
    known = [one for one in returns if one is not None]
    return float(np.mean(known)) if known and len(known) == len(returns) else None
