"""Pairs of sessions of one robot: before and after something about it changed, or nothing did; all from a seed.

The robot, with nominal numbers that nobody knows exactly, is the same in both sessions; noise, and what draws at
random, are drawn anew. Before the change it may have an effect of its own, which the library may not hold. A change is
an effect that appears, one that grows, or one that is gone. Half of the pairs repeat the same commands. The robot is a
hinge at 240 Hz.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind import cases, facts, motions, oracle, plan, reality, robots
from benchmarks.blind.cases import FAST_RATE, Case, EffectChoice, Made
from benchmarks.blind.dictionary import KINDS, PLAIN, UNKNOWN, available
from benchmarks.blind.effects.base import Effect

Array = NDArray[np.float64]

#: Shares of pairs whose robot has, before anything changed, no effect, one of the library, or one that it lacks.
BEFORE: Final = {"none": 0.5, "known": 0.35, "outside": 0.15}
#: Shares of changes: where the robot has no effect of the library, one appears.
CHANGES: Final = {"appears": 0.4, "grows": 0.3, "gone": 0.3}
#: A magnitude that grows, does so by a factor in this range of its distance from no effect.
GROWS: Final = (1.5, 3.0)
#: Recordings of a session.
TRIALS: Final = 6
#: Draws of a change until it shows.
DRAWS: Final = 200


@dataclass(frozen=True)
class Pair:
    """Two sessions.

    Attributes:
        before, after: of the same robot.
        change: ``none``, ``appears``, ``grows`` or ``gone``.
        effect: that changed; None: nothing did.
        same_motion: whether the commands are repeated.
    """

    before: Case
    after: Case
    change: str
    effect: EffectChoice | None
    same_motion: bool


def pair(count: int, seed: int, number: int) -> Pair:
    """One of the pairs of a run: every other one has a change; effects go through the whole library before one comes
    again.

    Args:
        count: how many are planned.
        seed: another one gives other pairs.
        number: of the pair.
    """
    hinge = plan.plan(count, seed, only=("none",), settings=(PLAIN,), rates=(FAST_RATE,), trials=TRIALS)[number]
    deck = np.random.default_rng([seed, 31]).permutation(available(PLAIN))
    return _pair(hinge, number, seed, str(deck[number // 2 % len(deck)]))


def _pair(case: Case, number: int, seed: int, name: str) -> Pair:
    rng = np.random.default_rng([seed, number, 32])
    same = bool(rng.random() < 0.5)
    has = str(rng.choice(list(BEFORE), p=list(BEFORE.values())))
    kind = str(rng.choice(list(CHANGES), p=list(CHANGES.values())))
    own: tuple[EffectChoice, ...] = ()
    if has == "outside":
        own = (cases.choose(PLAIN, str(rng.choice([n for n in UNKNOWN if PLAIN in KINDS[n].ranges])), rng),)
    if number % 2:  # nothing changes
        if has == "known":
            own = (cases.choose(PLAIN, name, rng),)
        return Pair(*(_with(case, own) for _ in range(2)), "none", None, same)
    if kind == "appears":
        if has == "known":
            own = (cases.choose(PLAIN, _beside(name, rng), rng),)
        for _ in range(DRAWS):
            chosen = cases.choose(PLAIN, name, rng)
            drawn = Pair(_with(case, own), _with(case, (*own, chosen)), kind, chosen, same)
            if _shows(drawn):
                break
        return drawn
    for _ in range(DRAWS):
        chosen = cases.choose(PLAIN, name, rng)
        more = _grown(chosen, rng)
        if kind == "grows":
            drawn = Pair(_with(case, (*own, chosen)), _with(case, (*own, more)), kind, more, same)
        else:
            drawn = Pair(_with(case, (*own, chosen)), _with(case, own), kind, chosen, same)
        if _shows(drawn):
            break
    return drawn


def _with(case: Case, effects: tuple[EffectChoice, ...]) -> Case:
    """With effects, and without the stated grids of readings that one of them rounds."""
    rounded = {plan.ROUNDED[effect.name] for effect in effects if effect.name in plan.ROUNDED}
    return replace(case, effects=effects, grids=tuple(grid for grid in case.grids if grid.kind not in rounded))


def _beside(name: str, rng: np.random.Generator) -> str:
    """An effect that neither undoes nor hides another by construction."""
    possible = [n for n in available(PLAIN) if n != name and not any({n, name} <= group for group in plan.ALIKE)]
    return str(rng.choice(possible))


def _grown(choice: EffectChoice, rng: np.random.Generator) -> EffectChoice:
    """The effect with its first parameter farther from that without effect; of a limit, tighter."""
    first, value = next(iter(choice.parameters.items()))
    factor = float(rng.uniform(*GROWS))
    if first == "factor":
        value = value**factor
    elif choice.name in ("rate_limit", "velocity_limit", "force_limit", "joint_elasticity"):
        value = value / factor
    else:
        value = value * factor
    if first == "probability":
        value = min(value, 0.5)
    return replace(choice, parameters={**choice.parameters, first: value})


# Recording -----------------------------------------------------------------------------------------------------------


def simulate(case: Case, folder: Path, session: int, commands: Array | None = None) -> Made:
    """Record a session of a robot.

    Args:
        case: of the robot.
        folder: where its model lies.
        session: 0 or 1: another one has other noise and, where nothing is given, other motions.
        commands: to be repeated, (ntrials, T, n); None: none are.
    """
    robot = cases.real_robot(case, folder)
    seed = case.seed + 104729 * session
    setup = cases.setup_of(case, robot, case.trials, round(case.seconds * case.rate), seed)
    setup = replace(setup, offsets=np.zeros(case.trials))
    effects = [*_effects(case, seed), *facts.converters(case.grids, robot)]
    if commands is not None:
        return Made(case, robot, reality.simulate(robot, effects, setup, commands), setup, folder=folder)
    reach, fastest = cases.reach_and_speed(robot, PLAIN)
    programs = [
        motions.joint_program(
            np.random.default_rng([seed, 8, k]),
            robot,
            [0],
            reach if k in cases.TEST else case.narrow * reach,
            fastest,
            case.seconds / cases.LONG,
        )
        for k in range(case.trials)
    ]
    conductor = motions.Conductor(programs, robot, setup.interface, setup.start, 1 / case.rate, None)
    return Made(case, robot, reality.simulate(robot, effects, setup, conductor), setup, folder=folder)


def record(pair: Pair, folder: Path) -> tuple[Made, Made]:
    """Both sessions; the model is written into the folder."""
    robots.put_model(PLAIN, folder)
    first = simulate(pair.before, folder, 0)
    again = first.recorded.commands[:, :-1] if pair.same_motion else None
    return first, simulate(pair.after, folder, 1, again)


def _effects(case: Case, seed: int) -> list[Effect]:
    """The case's effects; what they draw at random is another draw in every session."""
    made = []
    for number, choice in enumerate(case.effects):
        made.append(KINDS[choice.name].make(choice.parameters, [0], seed=seed * 10 + number))
    return made


def _shows(pair: Pair) -> bool:
    """Whether the change shows in the recordings: as an effect does in a case (:mod:`benchmarks.blind.oracle`), with
    the nominal numbers known, which are the same before and after."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        robots.put_model(PLAIN, folder)
        few = replace(pair.before, trials=3), replace(pair.after, trials=3)
        first = simulate(few[0], folder, 0)
        sigma = oracle.noise(first)
        silent = []
        for case in few:
            robot = cases.real_robot(case, folder)
            setup = replace(first.setup, silent=True)
            skew = float(np.prod([1 + e.parameters["rate"] for e in case.effects if e.name == "clock_skew"]))
            setup = replace(setup, rate=setup.rate / skew)
            run = reality.simulate(robot, _effects(case, case.seed), setup, first.recorded.commands[:, :-1])
            silent.append(oracle.stacked(run, slice(None)))
    change = (silent[1] - silent[0]) / sigma
    per = (change**2).mean(axis=(0, 1))
    distance = float((change**2).sum())
    return bool(per.max() >= oracle.VISIBLE and distance >= oracle.DISTANT)


def label(pair: Pair) -> dict[str, Any]:
    """The truth of a pair."""

    def told(effects: Sequence[EffectChoice]) -> list[dict[str, Any]]:
        return [{**asdict(effect), "class": KINDS[effect.name].group or effect.name} for effect in effects]

    return {
        "change": pair.change,
        "effect": None if pair.effect is None else told([pair.effect])[0],
        "before": told(pair.before.effects),
        "after": told(pair.after.effects),
        "same_motion": pair.same_motion,
        "rate": pair.before.rate,
        "seconds": pair.before.seconds,
        "narrow": pair.before.narrow,
    }
