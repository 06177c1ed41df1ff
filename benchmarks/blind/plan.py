"""Cases of a run, drawn from its number of cases and its seed; the first n of a longer run are those of a run of n.

Kinds come in a fixed order of a hundred, so that every run holds the mix; effects of a kind go through the whole
dictionary before one comes again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from benchmarks.blind import cases, facts
from benchmarks.blind.cases import FAST_RATE, FAST_SECONDS, RATE, SECONDS, TRIALS, Case, EffectChoice
from benchmarks.blind.dictionary import ARM, GRIPPER, KINDS, KNOWN, PLAIN, UNKNOWN, available

#: Of a hundred cases. 420 cases hold the 120, 150, 60 and 60 that the check asks for, and 40 with an effect left out.
SHARES: Final = {"none": 28, "one": 36, "two": 14, "outside": 14, "left_out": 8}
#: How often a setting comes, of ten.
SETTINGS: Final = {GRIPPER: 7, ARM: 1, PLAIN: 2}
#: Share of the gripper's and the plain model's cases that run at the environments' rate; with the arm's, which never
#: do, half of all.
FAST_SHARE: Final = 0.55
RATES: Final = (RATE, FAST_RATE)
#: Offset of the object that the user says, where it is not centred [m].
OFFSET: Final = 0.005
#: Share of cases whose nominal masses are another publication's.
OTHER_SOURCE: Final = 0.2
#: Effects that are a grid of readings themselves, and of which.
ROUNDED: Final = {"encoder_quantization": "position", "force_quantization": "force"}
#: Two effects that undo or hide each other by construction are no pair: only different stages or classes are drawn.
ALIKE: Final = (
    {"force_gain", "torque_constant", "servo_stiffness", "joint_elasticity", "force_nonlinearity"},
    {"command_delay", "clock_offset", "command_lag", "force_delay", "force_lag", "velocity_filter"},
    {"coulomb_friction", "stribeck_friction", "load_dependent_friction", "asymmetric_friction", "backlash"},
    {"viscous_friction", "servo_damping"},
    {"rate_limit", "velocity_limit"},
    {"object_size", "object_offset", "encoder_bias"},
)


def kinds(count: int, seed: int, only: Sequence[str] = ()) -> list[str]:
    """Kind of every case."""
    wanted = [kind for kind in SHARES if not only or kind in only]
    out: list[str] = []
    given = dict.fromkeys(wanted, 0)
    for _ in range(count):  # the kind that is furthest behind its share comes next
        kind = min(wanted, key=lambda k: (given[k] + 1) / SHARES[k])
        given[kind] += 1
        out.append(kind)
    return out


def plan(
    count: int,
    seed: int,
    *,
    only: Sequence[str] = (),
    settings: Sequence[str] = (),
    rates: Sequence[float] = (),
    trials: int = TRIALS,
    seconds: float | None = None,
) -> list[Case]:
    """The cases of a run.

    Args:
        count: how many.
        seed: another gives other cases throughout.
        only: kinds to draw, of :data:`SHARES`; all by default.
        settings: to draw from; all by default.
        rates: of control [Hz], of :data:`RATES`; all by default. The arm is at the real robot's, whatever is given.
        trials: of a case.
        seconds: of a trial; None: by its rate.
    """
    turn = dict.fromkeys(SHARES, 0)
    out = []
    for number, kind in enumerate(kinds(count, seed, only)):
        case = _case(number, kind, turn[kind], seed, settings)
        case = _timed(case, number, seed, rates or RATES, trials, seconds)
        out.append(_with_facts(case, number, seed))
        turn[kind] += 1
    return out


def _case(number: int, kind: str, turn: int, seed: int, settings: Sequence[str]) -> Case:
    rng = np.random.default_rng([seed, number, 11])
    shares = {name: share for name, share in SETTINGS.items() if not settings or name in settings}
    setting = str(rng.choice(list(shares), p=np.array(list(shares.values())) / sum(shares.values())))
    names: tuple[str, ...] = ()
    if kind in ("one", "left_out", "outside"):
        deck = UNKNOWN if kind == "outside" else KNOWN
        name = _dealt(deck, turn, [seed, {"one": 21, "left_out": 22, "outside": 23}[kind]])
        if setting not in KINDS[name].ranges:
            possible = [s for s in shares if s in KINDS[name].ranges]
            if possible:
                setting = str(rng.choice(possible))
            else:  # the chosen settings do not know this effect: another one
                name = str(rng.choice([n for n in deck if setting in KINDS[n].ranges]))
        names = (name,)
    elif kind == "two":
        names = pair(available(setting), rng)
    choices: tuple[EffectChoice, ...] = tuple(cases.choose(setting, name, rng) for name in names)
    gripper = setting == GRIPPER
    position = setting == PLAIN or rng.random() < 0.4
    offset = float(rng.choice([-OFFSET, OFFSET])) if gripper and rng.random() < 0.5 else 0.0
    return Case(
        seed=int(rng.integers(2**31)),
        setting=setting,
        interface="position" if position else "velocity",
        offset=offset,
        effects=choices,
        spread=float(np.round(rng.uniform(0.03, 0.05), 4)),
        other_source=bool(setting != PLAIN and rng.random() < OTHER_SOURCE),
        without=names if kind == "left_out" else (),
    )


def _with_facts(case: Case, number: int, seed: int) -> Case:
    """A case with the converters of its sensors and how far its session moves."""
    rounded = frozenset(ROUNDED[effect.name] for effect in case.effects if effect.name in ROUNDED)
    gripper = case.setting == GRIPPER
    grids, narrow = facts.draw([seed, number, 17], cells=gripper, rounded=rounded, gripper=gripper)
    return replace(case, grids=grids, narrow=narrow)


def _timed(case: Case, number: int, seed: int, rates: Sequence[float], trials: int, given: float | None) -> Case:
    """A case with its control rate and the length of its session."""
    rng = np.random.default_rng([seed, number, 13])
    fast, seconds = rng.random() < FAST_SHARE, round(float(rng.uniform(*FAST_SECONDS)), 1)
    rate = (FAST_RATE if fast else RATE) if len(rates) > 1 else rates[0]
    if case.setting == ARM or rate == RATE:
        return replace(case, rate=RATE, seconds=given or SECONDS, trials=trials)
    return replace(case, rate=FAST_RATE, seconds=given or seconds, trials=trials)


def _dealt(deck: Sequence[str], turn: int, seed: list[int]) -> str:
    """One of the deck; each comes once before any comes again."""
    whole, at = divmod(turn, len(deck))
    return str(np.random.default_rng([*seed, whole]).permutation(deck)[at])


def pair(names: Sequence[str], rng: np.random.Generator) -> tuple[str, str]:
    """Two effects that neither undo nor hide each other by construction."""
    while True:
        first, second = (str(name) for name in rng.choice(names, 2, replace=False))
        if not any(first in group and second in group for group in ALIKE):
            return first, second
