"""What a calibration names, each with the interval of its magnitude, and simulators drawn from these intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy import stats
from scipy.stats import qmc

from tiago_mj.effects import EFFECTS, Entry, read_effects, written
from tiago_mj.export.found import calibration_file
from tiago_mj.gap.result import Named, Result
from tiago_mj.io.quantities import quantity
from tiago_mj.io.quoting import is_number, quoted

#: What the intervals of a calibration hold.
LEVEL: Final = 0.9
#: Standard deviations of a normal distribution to either end of such an interval.
SPAN: Final = float(stats.norm.ppf(0.5 + LEVEL / 2))
#: How the nominal model's own numbers as fitted are called, all together.
NUMBERS: Final = "numbers as fitted"

Spans = Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class Item:
    """What is costed by itself: an effect on its targets, or all of the model's own numbers as fitted together.

    Attributes:
        name: of the effect, or :data:`NUMBERS`.
        target: names; None is all of them.
        entries: as simulators take them, at the fitted magnitudes; one, but of the numbers.
        spans: per entry the 90 % interval by parameter, of those that have one.
        units: by parameter, where the calibration says them.
    """

    name: str
    target: tuple[str, ...] | None
    entries: tuple[Entry, ...]
    spans: tuple[Spans, ...]
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def uncertain(self) -> bool:
        """Whether a magnitude has an interval."""
        return any(self.spans)

    @property
    def label(self) -> str:
        """Name and targets, in words."""
        return self.name if self.target is None else f"{self.name} on {', '.join(self.target)}"

    @property
    def magnitude(self) -> str:
        """The fitted numbers, each with its interval; empty of the model's own, which are many."""
        if self.name == NUMBERS:
            return f"{len(self.entries)} of the model's own"
        (entry,), (spans,) = self.entries, self.spans
        return ", ".join(self._told(entry, key, spans.get(key)) for key in entry.parameters)

    def _told(self, entry: Entry, key: str, span: tuple[float, float] | None) -> str:
        unit = self.units.get(key, "")
        word = "" if len(entry.parameters) == 1 else f"{key} "
        value = quantity(entry.parameters[key], unit)
        return f"{word}{value}" + (f" ({quantity(span[0], unit)} to {quantity(span[1], unit)})" if span else "")


def items_of(given: Any, *, numbers: bool = True) -> tuple[Item, ...]:
    """What is named, one item an effect and its targets.

    Args:
        given: a DIAGNOSIS folder, a ``calibration.yaml``, what :func:`tiago_mj.gap.pipeline.diagnose` returned, or
            effects in any other form (docs/effects.md); a parameter may be ``{"value", "low", "high"}`` with the ends
            of its 90 % interval.
        numbers: whether the model's own numbers as fitted are an item, where there are any.

    Raises:
        ValueError: it is no diagnosis, an effect is unusable, or nothing is named; one line.
    """
    effects, fitted = _listed(given)
    items = [_item(one) for one in effects]
    if numbers and fitted:
        parts = [_item(one) for one in fitted]
        entries = tuple(entry for part in parts for entry in part.entries)
        items.append(Item(NUMBERS, None, entries, tuple(span for part in parts for span in part.spans)))
    if not items:
        raise ValueError("the diagnosis names no effect, so that there is nothing that could cost the policy anything")
    labels = [item.label for item in items]
    for label in labels:
        if labels.count(label) > 1:
            raise ValueError(f"{label} is named {labels.count(label)} times: give it once, with one magnitude")
    return tuple(items)


def draws(items: Sequence[Item], count: int, seed: int) -> list[tuple[Item, ...]]:
    """Items whose magnitudes are drawn from their intervals; only one draw, as fitted, where none has an interval.

    Every magnitude is drawn by itself: normal, of a factor its logarithm, with the fitted value as median and the
    interval's ends as the 5 % and 95 % quantiles, within what a fit may try. The draws are a Latin hypercube (McKay,
    Beckman and Conover 1979): each of ``count`` equal parts of a magnitude's probability has one of them.

    Args:
        items: of :func:`items_of`.
        count: of the draws.
        seed: of the hypercube.
    """
    places = [(i, e, key) for i, item in enumerate(items) for e, span in enumerate(item.spans) for key in span]
    if not places:
        return [tuple(items)]
    quantiles = qmc.LatinHypercube(len(places), rng=np.random.default_rng(seed)).random(count)
    return [_drawn(items, places, stats.norm.ppf(row)) for row in quantiles]


def _drawn(items: Sequence[Item], places: Sequence[tuple[int, int, str]], normal: Any) -> tuple[Item, ...]:
    parameters = [[dict(entry.parameters) for entry in item.entries] for item in items]
    for (i, e, key), z in zip(places, normal, strict=True):
        entry, span = items[i].entries[e], items[i].spans[e][key]
        parameters[i][e][key] = _value(entry, key, span, float(z))
    return tuple(
        replace(item, entries=tuple(replace(e, parameters=p) for e, p in zip(item.entries, own, strict=True)))
        for item, own in zip(items, parameters, strict=True)
    )


def _value(entry: Entry, key: str, span: tuple[float, float], z: float) -> float:
    """The value that lies ``z`` standard deviations from the fitted one."""
    value, (low, high) = float(entry.parameters[key]), span
    declared = EFFECTS[entry.name].parameters.get(key)
    if declared is not None and declared.identity == 1.0 and low > 0:
        side = math.log(value / low) if z < 0 else math.log(high / value)
        drawn = value * math.exp(z * side / SPAN)
    else:
        drawn = value + z * (value - low if z < 0 else high - value) / SPAN
    if declared is None:
        return min(max(drawn, low), high)
    least, most = min(low for low, _ in declared.bounds), max(high for _, high in declared.bounds)
    if declared.nominal is not None:  # bounds are shares of a limit: they tell the sign alone
        least, most = 0.0 if least >= 0 else -math.inf, math.inf
    if declared.possible is not None:
        least, most = max(least, declared.possible[0]), min(most, declared.possible[1])
    return min(max(drawn, min(low, least)), max(high, most))


# Reading --------------------------------------------------------------------------------------------------------------


def _listed(given: Any) -> tuple[list[Any], list[Any]]:
    """Effects, and the model's own numbers, as raw mappings or entries."""
    if isinstance(given, Result):
        return [*getattr(given, "given", ()), *given.best.effects], [one.effect for one in given.numbers]
    if isinstance(given, (str, Path)):
        given = _loaded(given)
    if isinstance(given, Mapping) and "schema" in given:
        said = written.calibration(given)
        return list(said.get("effects") or []), list(said.get("numbers") or [])
    if isinstance(given, Mapping):
        return [{"name": name, "parameters": parameters} for name, parameters in given.items()], []
    if not isinstance(given, Sequence):
        raise ValueError(
            f"the diagnosis is {type(given).__name__}: give the folder that tiago-mj diagnose --out wrote, or effects"
        )
    return list(given), []


def _loaded(given: str | Path) -> Any:
    if written.is_json(given):
        return written.load(given)
    path = calibration_file(Path(given))
    loaded = written.load(path)
    if not isinstance(loaded, (Mapping, list)):
        raise ValueError(f"{path} is no calibration: give the folder that tiago-mj diagnose --out wrote")
    return loaded


def _item(one: Any) -> Item:
    if isinstance(one, Named):  # of a diagnosis in memory
        entry, parameters = one.entry(), {key: vars(value) for key, value in one.parameters.items()}
    else:
        (entry,) = read_effects([one])
        parameters = {} if isinstance(one, Entry) else one.get("parameters") or {}
    spans = {key: span for key, value in parameters.items() if (span := _span(entry, key, value)) is not None}
    units = {key: value["unit"] for key, value in parameters.items() if isinstance(value, Mapping) and "unit" in value}
    return Item(entry.name, entry.target, (entry,), (spans,), units)


def _span(entry: Entry, key: str, said: Any) -> tuple[float, float] | None:
    """The interval of a parameter, None where it has none.

    Raises:
        ValueError: its ends do not lie around the value; one line.
    """
    if not isinstance(said, Mapping):
        return None
    low, high = said.get("low"), said.get("high")
    if low is None or high is None or (is_number(low) and is_number(high) and low == high):
        return None
    if not (is_number(low) and is_number(high) and low <= entry.parameters[key] <= high):
        value = quoted(said.get("value"))
        raise ValueError(
            f"effect {entry.name!r}: {key} is {value} from {quoted(low)} to {quoted(high)}: give an interval that "
            "holds the value"
        )
    return float(low), float(high)
