"""Cases of a run whose recordings hold motion and measured efforts, without commands.

The robot moves under the servos of :mod:`benchmarks.blind.reality`, which the recordings do not tell. What they tell of
its torques comes from a *torque sensor* behind the motor (noise, gain, offset, delay) or from the *motor's current*
times a torque constant that the user knows to 20 % and says so. Both give all that the drive gives, what compensates
the robot's own weight too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from benchmarks.blind import plan
from benchmarks.blind.cases import Case, choose
from benchmarks.blind.dictionary import ARM, PLAIN, SIX, ranges
from benchmarks.blind.effort_sensors import CURRENT, SENSOR

#: Version of these cases.
VERSION: Final = 9
#: How often a setting comes, of ten, and its control rate [Hz], trials and seconds of each: as robots of a kind log.
SETTINGS: Final = {PLAIN: 4, ARM: 3, SIX: 3}
SESSION: Final = {PLAIN: (240.0, 6, 4.0), ARM: (100.0, 4, 6.0), SIX: (100.0, 4, 6.0)}
#: Effects that torques along a motion can show, by what they add to these; of currents the motor's own cogging, too,
#: which a sensor behind the motor does not see.
SHOWN: Final = (
    *("coulomb_friction", "viscous_friction", "stribeck_friction", "load_dependent_friction", "asymmetric_friction"),
    *("armature", "payload"),
)
SHOWN_BY_CURRENTS: Final = ("motor_cogging",)
OUTSIDE: Final = ("cable_tug", "place_friction", "stiffening_spring")
OUTSIDE_BY_CURRENTS: Final = ("thermal_fade",)


def cases(count: int, seed: int, only: Sequence[str] = (), asked: Sequence[str] = ()) -> list[Case]:
    """The cases of a run.

    Args:
        count: how many.
        seed: another gives other cases throughout.
        only: kinds to draw; none is ``left_out``.
        asked: effects of which every single one is, and one of each pair; empty: of those that cases have.
    """
    wanted = [kind for kind in plan.SHARES if kind != "left_out" and (not only or kind in only)]
    turn = dict.fromkeys(wanted, 0)
    out = []
    for number, kind in enumerate(plan.kinds(count, seed, wanted)):
        out.append(_case(number, kind, turn[kind], seed, asked))
        turn[kind] += 1
    return out


def _case(number: int, kind: str, turn: int, seed: int, asked: Sequence[str]) -> Case:
    rng = np.random.default_rng([seed, number, 41])
    setting = str(rng.choice(list(SETTINGS), p=np.array(list(SETTINGS.values())) / sum(SETTINGS.values())))
    if asked and kind in ("one", "two"):
        setting = str(rng.choice(_settings(asked)))
    effort = str(rng.choice((SENSOR, CURRENT)))
    current = effort == CURRENT
    known = (*SHOWN, *(SHOWN_BY_CURRENTS if current else ()))
    deck = (*OUTSIDE, *(OUTSIDE_BY_CURRENTS if current else ())) if kind == "outside" else asked or known
    possible = [name for name in deck if ranges(name, setting)]
    chosen: tuple[str, ...] = ()
    if kind in ("one", "outside"):
        order = np.random.default_rng([seed, 42, int(kind == "one")]).permutation(len(possible))
        chosen = (possible[order[turn % len(possible)]],)
    elif kind == "two":
        chosen = (str(rng.choice(asked)), str(rng.choice(known))) if asked else plan.pair(possible, rng)
    rate, trials, seconds = SESSION[setting]
    return Case(
        seed=int(rng.integers(2**31)),
        setting=setting,
        interface="position",
        effects=tuple(choose(setting, name, rng) for name in chosen),
        spread=float(np.round(rng.uniform(0.03, 0.05), 4)),
        trials=trials,
        seconds=seconds,
        rate=rate,
        version=VERSION,
        effort=effort,
    )


def _settings(asked: Sequence[str]) -> list[str]:
    """Those that can have all of some effects.

    Raises:
        ValueError: none can.
    """
    found = [one for one in SETTINGS if all(ranges(name, one) for name in asked)]
    if not found:
        raise ValueError(f"--effects: no robot of the check can have {', '.join(asked)}: leave some out")
    return found
