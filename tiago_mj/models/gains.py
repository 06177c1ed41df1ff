"""How well the gains of position servos are known: ``kp=50±30%,kv=0.5±50%``, as a command line or a map says it; two
numbers alone, ``50,0.5``, are both, and ``kd`` is another name of ``kv``.

A gain that nobody knows is no gap: a diagnosis fits it along with every explanation, within what it is known to, and
names neither it nor what would stand in for it (:mod:`tiago_mj.recordings.nominal_priors`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from tiago_mj.io.quantities import NINETY
from tiago_mj.io.quoting import quoted

#: Stiffness and damping of a servo [N/m and N·s/m, or per rad].
GAINS: Final = ("kp", "kv")
#: Standard deviation of a guessed gain's logarithm: nine in ten lie within ten times and a tenth of it. By the rule of
#: the converter Go2's 20 N·m/rad would be 2370, TIAGo's arm_1's 3000 is 4300 and its fingers' 2000 N/m is 1600.
GUESSED: Final = math.log(10) / NINETY
GUESS: Final = "guessed"
#: Name of the text in which a converted model says which of its gains were guessed.
TEXT: Final = "servo_gains"
#: Other names of them.
ALIASES: Final = {"kd": "kv"}
MEND: Final = (
    "write gains as kp=50±30%,kv=0.5±50% or 50,0.5 (of one actuator as elbow.kp=50±30%), ±30% where the model has the "
    "value, or guessed"
)
_SAID: Final = re.compile(r"(?P<value>\d[\d.eE+-]*?)?\s*(?:(?:±|\+/?-)\s*(?P<share>\d[\d.]*)\s*%|(?P<guess>guessed))?")


@dataclass(frozen=True)
class Gain:
    """A gain.

    Attributes:
        value: in its unit; None: the model's.
        known_to: one standard deviation of its logarithm; None: what is usual.
    """

    value: float | None
    known_to: float | None


#: By actuator (None for all) and one of :data:`GAINS`.
Gains = Mapping[tuple[str | None, str], Gain]


def parsed(said: Any) -> Gains:
    """Gains from a line, ``kp=50±30%``, from ``guessed`` alone, or from a mapping: of gains, or of actuators to these.

    Raises:
        ValueError: it says something else; one line.
    """
    if said == GUESS:
        return {(None, name): Gain(None, GUESSED) for name in GAINS}
    if isinstance(said, str):
        parts = [part for part in said.split(",") if part.strip()]
        if len(parts) == len(GAINS) and not any("=" in part for part in parts):
            parts = [f"{name}={part}" for name, part in zip(GAINS, parts, strict=True)]
        items = [(key.strip(), value) for key, _, value in (part.partition("=") for part in parts)]
    elif isinstance(said, Mapping):
        items = []
        for key, value in said.items():
            inner = value.items() if isinstance(value, Mapping) else [(None, value)]
            items += [(str(key) if name is None else f"{key}.{name}", one) for name, one in inner]
    else:
        raise ValueError(f"gains are {quoted(said)}: {MEND}")
    found = {}
    for key, value in items:
        actuator, _, name = key.rpartition(".")
        name = ALIASES.get(name, name)
        if name not in GAINS:
            raise ValueError(f"gains name {quoted(key)}, which is neither kp nor kv: {MEND}")
        found[actuator or None, name] = _gain(key, value)
    if not found:
        raise ValueError(f"gains say nothing: {MEND}")
    return found


def written(gains: Gains) -> str:
    """The line that :func:`parsed` reads."""
    return ",".join(f"{f'{who}.' if who else ''}{name}={_written(gain)}" for (who, name), gain in gains.items())


def of(gains: Gains, actuator: str, name: str) -> Gain | None:
    """What is said of an actuator's gain: by its name, or else of all; None: nothing."""
    return gains.get((actuator, name), gains.get((None, name)))


def _written(gain: Gain) -> str:
    value = "" if gain.value is None else f"{gain.value:g}"
    if gain.known_to is None:
        return value
    return f"{value} {GUESS}".strip() if gain.known_to == GUESSED else f"{value}±{100 * gain.known_to:g}%"


def _gain(key: str, said: Any) -> Gain:
    """One gain: a number, ``50 ± 30 %``, ``± 30 %``, ``guessed`` or ``50 guessed``."""
    text = f"{said:.17g}" if isinstance(said, float) else str(said).strip()
    match = _SAID.fullmatch(text)
    try:
        if match is None or isinstance(said, bool) or not text:
            raise ValueError
        value = None if match["value"] is None else float(match["value"])
        share = None if match["share"] is None else float(match["share"]) / 100
    except ValueError:
        raise ValueError(f"gain {key} is {quoted(said)}: {MEND}") from None
    if (value is not None and not 0 <= value < math.inf) or (share is not None and not 0 < share < math.inf):
        raise ValueError(f"gain {key} is {quoted(said)}: give a value of 0 or more, and an uncertainty above 0 %")
    return Gain(value, GUESSED if match["guess"] else share)
