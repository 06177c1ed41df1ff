"""Domain randomisation: every training episode has a simulator of its own, drawn from ranges or from a diagnosis.

Ranges are a file such as

    command_delay: {seconds: [0.0, 0.03]}
    servo_stiffness: {factor: [0.5, 2.0]}

whose names are those of docs/effects.md. A factor is drawn log-uniformly, everything else uniformly; one draw serves
all targets of an effect. Of a diagnosis the joint posterior is drawn (:mod:`tiago_mj.randomisation.posterior`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Final

import numpy as np

from tiago_mj.effects import EFFECTS, Entry, read_effects
from tiago_mj.effects.nominal import check_entries
from tiago_mj.envs.robot_env import RobotEnv
from tiago_mj.io.quoting import is_number, quoted, unquoted
from tiago_mj.randomisation.posterior import Posterior, described

Ranges = Mapping[str, Mapping[str, Sequence[float]]]
#: Key of settings under which a posterior stands; no effect has this name.
POSTERIOR: Final = "posterior"


def read_ranges(given: Any, where: str) -> dict[str, dict[str, list[float]]]:
    """Ranges that are checked.

    Args:
        given: effect name to parameter name to ``[low, high]`` or one number.
        where: what to call it in a complaint.

    Raises:
        ValueError: it has another form, an effect or parameter is unknown, or a value is impossible; one line.
    """
    if not isinstance(given, Mapping) or not given:
        raise ValueError(f"{where}: give effects with ranges, such as 'command_delay: {{seconds: [0, 0.03]}}'")
    ranges: dict[str, dict[str, list[float]]] = {}
    for name, parameters in given.items():
        if not isinstance(parameters, Mapping) or not parameters:
            raise ValueError(f"{where}: {unquoted(name)} needs a range of a parameter, such as {{seconds: [0, 0.03]}}")
        ranges[str(name)] = {str(key): _range(where, f"{name}.{key}", value) for key, value in parameters.items()}
    for end in (0, 1):
        try:
            _corner(ranges, end)
        except ValueError as fault:
            raise ValueError(f"{where}: {fault}") from fault
    return ranges


def draw(ranges: Ranges, rng: np.random.Generator) -> tuple[Entry, ...]:
    """Effects of one simulator."""
    drawn = []
    for name, parameters in ranges.items():
        values = {}
        for key, (low, high) in parameters.items():
            if EFFECTS[name].parameters[key].identity == 1.0 and low > 0:
                values[key] = math.exp(rng.uniform(math.log(low), math.log(high)))
            else:
                values[key] = float(rng.uniform(low, high))
        drawn.append(Entry(name, None, values))
    return tuple(drawn)


def drawing(given: Mapping[str, Any]) -> Callable[[np.random.Generator], tuple[Entry, ...]]:
    """What draws the effects of an episode, of a training's settings."""
    if POSTERIOR in given:
        return Posterior.of_data(given[POSTERIOR]).sample
    return partial(draw, given)


def check_fits(given: Mapping[str, Any], core: RobotEnv) -> None:
    """Refuse what cannot be drawn for an environment, before its first episode.

    Raises:
        ValueError: it names a part that this robot does not have, or takes away more than the model has; one line.
    """
    model, wiring = core.model, core.wiring()
    if POSTERIOR not in given:
        for end in (0, 1):
            check_entries(_corner(given, end), model, wiring)
        return
    Posterior.of_data(given[POSTERIOR]).check_fits(model, wiring)


def told(given: Mapping[str, Any]) -> list[str]:
    """What is drawn, a line each; of ranges nothing, as their file says it."""
    return described(Posterior.of_data(given[POSTERIOR])) if POSTERIOR in given else []


def in_short(given: Mapping[str, Any]) -> Any:
    """What a card says of it: the ranges, or where the posterior is from and what is drawn."""
    if POSTERIOR not in given:
        return given
    found = Posterior.of_data(given[POSTERIOR])
    return f"{'; '.join(line.strip() for line in described(found))} (sha256 {found.sha256})"


def _corner(ranges: Ranges, end: int) -> tuple[Entry, ...]:
    return read_effects({name: {key: pair[end] for key, pair in one.items()} for name, one in ranges.items()})


def _range(where: str, name: str, value: Any) -> list[float]:
    pair = list(value) if isinstance(value, (list, tuple)) else [value, value]
    if len(pair) != 2 or not all(map(is_number, pair)) or pair[0] > pair[1]:
        raise ValueError(f"{where}: {unquoted(name)} is {quoted(value)}: give [low, high], or one number")
    return [float(one) for one in pair]
