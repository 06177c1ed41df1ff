"""Effects as a user writes them: a list, the short form, or a calibration file; and as entries that are checked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.declare import EFFECTS, Effect
from tiago_mj.effects.fields import Detail, Parameter
from tiago_mj.effects.targets import Targets
from tiago_mj.io.loading import is_file
from tiago_mj.io.quantities import SMALLER, quantity
from tiago_mj.io.quoting import did_you_mean, is_one_of, quoted

Array = NDArray[np.float64]

#: Of one simulator; a verdict names two.
MOST: Final = 1000
#: Where all effects are listed.
LISTED: Final = "all are in docs/effects.md and in tiago_mj.effects.EFFECTS"
#: What a user gives may lie this many times farther than what a fit tries.
FAR: Final = 10.0


@dataclass(frozen=True)
class Entry:
    """One effect on its targets. Parameters left out take their defaults.

    Attributes:
        name: of the effect.
        target: names of actuators, joints or sensors; None is all of them.
        parameters: by name.
        fitted: whether a diagnosis found them; they are not questioned then.
    """

    name: str
    target: tuple[str, ...] | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    fitted: bool = field(default=False, compare=False)

    def __hash__(self) -> int:
        return hash((self.name, self.target, tuple(sorted(self.parameters.items()))))


def read_effects(given: Any, *, numbers: bool = True) -> tuple[Entry, ...]:
    """Entries of what a user gave.

    Args:
        given: None, a list of ``{"name", "target", "parameters"}``, a mapping ``{name: parameters}`` (target all,
            ``{}`` for the defaults), a list of :class:`Entry`, the path of a calibration YAML, or JSON text of the
            above; or a list of several of these, one on top of the other.
        numbers: whether the numbers of the nominal model count that a calibration has as fitted, beside its effects.

    Raises:
        ValueError: an unknown effect or parameter, a value that is no finite number, a file of another schema; one
            line.
    """
    return () if given is None else _read(given, files=True, numbers=numbers)


def _read(given: Any, files: bool, numbers: bool) -> tuple[Entry, ...]:
    """The same; what a file holds may not name files, itself among them."""
    if isinstance(given, (str, Path)):
        from tiago_mj.effects import written

        given, files = written.load(given), files and written.is_json(given)
    if isinstance(given, Mapping):
        given = _listed(given, numbers)
    if not isinstance(given, Sequence) or isinstance(given, (str, bytes)):
        raise ValueError(
            f"effects are {type(given).__name__}: give a list, a mapping name to parameters, or a YAML file"
        )
    if len(given) > MOST:
        raise ValueError(f"effects are {len(given)}: give at most {MOST}")
    return tuple(entry for item in given for entry in _entries(item, files, numbers))


def _listed(given: Mapping[Any, Any], numbers: bool) -> Any:
    """Entries of a calibration or of the short form."""
    if "schema" not in given:
        return [{"name": name, "parameters": parameters} for name, parameters in given.items()]
    from tiago_mj.effects import written

    said = written.calibration(given)
    return [*(said.get("effects") or []), *((numbers and said.get("numbers")) or [])]


def arrays(declared: type[Effect], sims: Sequence[Sequence[Entry]], targets: Targets) -> Effect:
    """One effect of many simulations: parameters (nsim, ntargets), identity where an entry does not reach.

    Raises:
        ValueError: an entry names a target that the robot does not have.
    """
    names = targets.names(declared.targets)
    values = {
        key: np.full((len(sims), len(names)), p.default[0] if p.identity is None else p.identity)
        for key, p in declared.parameters.items()
    }
    values |= {key: np.zeros((len(sims), len(names))) for key in declared.details}
    values |= {key: np.full((len(sims), len(names)), form.values[0]) for key, form in declared.forms.items()}
    for sim, entries in enumerate(sims):
        for entry in entries:
            if entry.name != declared.name:
                continue
            for index in _reach(entry, declared, names):
                for key, more in declared.details.items():
                    if more.usual is not None:
                        values[key][sim, index] = entry.parameters.get(key, values[key][sim, index])
                        continue
                    there = _amount(declared, entry, targets.side(declared.targets, index))
                    before = values[next(iter(declared.parameters))][sim, index], values[key][sim, index]
                    values[key][sim, index] = _centre(before, (there, entry.parameters.get(key, 0.0)))
                for key, p in declared.parameters.items():
                    default = p.default[targets.side(declared.targets, index)]
                    if p.nominal is not None:
                        default *= targets.nominal(p.nominal, declared.targets, index)
                    value = entry.parameters.get(key, default)
                    values[key][sim, index] = _together(p.identity, values[key][sim, index], value)
                for key, form in declared.forms.items():
                    values[key][sim, index] = entry.parameters.get(key, form.values[0])
    return declared(values, names)


def _together(identity: float | None, present: float, value: float) -> float:
    """Two entries of one effect on one target: factors multiply, additions add, of two limits the tighter holds."""
    if identity is None:
        return value
    if identity == 1.0:
        return present * value
    return present + value if identity == 0.0 else min(present, value)


def _amount(declared: type[Effect], entry: Entry, side: int) -> float:
    """How much there is of what an effect's details are the place of."""
    first = next(iter(declared.parameters.values()))
    return entry.parameters.get(first.name, first.default[side])


def _centre(one: tuple[float, float], other: tuple[float, float]) -> float:
    """Common centre of two (amount, place); the other's place where the first amount is 0, or both together are."""
    both = one[0] + other[0]
    return (one[0] * one[1] + other[0] * other[1]) / both if one[0] and both else other[1]


def _reach(entry: Entry, declared: type[Effect], names: tuple[str, ...]) -> list[int]:
    if entry.target is None:
        return [len(names) - 1] if declared.common else list(range(len(names)))
    unknown = [name for name in entry.target if name not in names]
    if unknown:
        raise ValueError(
            f"effect {entry.name!r} has target {quoted(unknown[0])}: this robot's {declared.targets} targets are "
            f"{', '.join(names) or 'none'}"
        )
    return [names.index(name) for name in entry.target]


def _entries(item: Any, files: bool, numbers: bool) -> tuple[Entry, ...]:
    if isinstance(item, Entry):
        return (item,)
    if files and (isinstance(item, Path) or (isinstance(item, str) and _is_source(item))):
        return _read(item, files, numbers)
    return (_entry(item),)


def _is_source(text: str) -> bool:
    """Whether a text is JSON or names a file, rather than an effect."""
    from tiago_mj.effects import written

    return written.is_json(text) or text.lower().endswith((".yaml", ".yml")) or is_file(text)


def _entry(item: Any) -> Entry:
    from tiago_mj.effects import written

    if not isinstance(item, Mapping) or "name" not in item:
        raise ValueError(
            f"effect {quoted(item)} has no name: write {{'name': ..., 'target': ..., 'parameters': {{...}}}}"
        )
    name = item["name"]
    if not is_one_of(name, EFFECTS):
        raise ValueError(f"effect {quoted(name)} is unknown: {did_you_mean(name, tuple(EFFECTS), LISTED)}")
    target, values, fitted = written.entry(name, {key: value for key, value in item.items() if key != "name"})
    declared, forms, details = EFFECTS[name].parameters, EFFECTS[name].forms, EFFECTS[name].details
    for key, number in values.items():
        if key not in declared and key not in forms and key not in details:
            raise ValueError(
                f"effect {name!r} has no parameter {quoted(key)}: {did_you_mean(key, (*declared, *forms, *details))}"
            )
        if math.isnan(number):
            raise ValueError(f"effect {name!r}: {key} is nan, give a number")
        if key in declared:
            _check_possible(name, declared[key], number)
        elif key in details:
            _check_detail(name, details[key], number)
        elif number not in forms[key].values:
            possible = ", ".join(f"{one:g}" for one in forms[key].values)
            raise ValueError(f"effect {name!r}: {key} is {number:g}, use one of {possible}")
    if not fitted:
        for key, number in values.items():
            _check_size(name, declared.get(key), number, (0, 1))
    return Entry(name, target, values, fitted)


def check_sizes(entries: Sequence[Entry], targets: Targets) -> None:
    """Refuse magnitudes that cannot be meant, now that it is known which targets slide and which turn.

    Raises:
        ValueError: says what is typical, and the likely slip.
    """
    for entry in entries:
        declared = EFFECTS[entry.name]
        names = targets.names(declared.targets)
        for index in () if entry.fitted else _reach(entry, declared, names):
            side = targets.side(declared.targets, index)
            for key, number in entry.parameters.items():
                _check_size(entry.name, declared.parameters.get(key), number, (side,))


def _check_size(name: str, p: Parameter | None, number: float, sides: Sequence[int]) -> None:
    """A value may lie beyond what a fit tries, as large robots have it, but not :data:`FAR` times as far.

    What has no unit of its own, is a share of a limit, or is absent when large, may be as large as it is given; what is
    taken from the model is compared with what that has (:mod:`tiago_mj.effects.nominal`).
    """
    if number < 0 and EFFECTS[name].takes_from is not None:
        return
    if p is None or p.nominal is not None or p.identity == math.inf or not math.isfinite(number):
        return
    if any("sensor unit" in unit or unit == "-" for unit in p.unit):
        return
    if any(FAR * min(p.bounds[side][0], 0.0) <= number <= FAR * p.bounds[side][1] for side in sides):
        return
    units: dict[str, int] = {}
    for side in sides:
        units.setdefault(p.unit[side], side)
    given = " or ".join(f"{number:g} {unit}" for unit in units)
    typical = " or ".join(quantity(p.default[side], unit) for unit, side in units.items())
    most = " or ".join(quantity(FAR * p.bounds[side][number > 0], unit) for unit, side in units.items())
    slips = dict.fromkeys(slip for unit, side in units.items() for slip in _slips(number, unit, p.bounds[side])[:1])
    hint = f"did you mean {' or '.join(slips)}?" if slips else f"give it in {' or '.join(units)}"
    raise ValueError(
        f"effect {name!r}: {p.name} is {given}, where {typical} is typical and {most} the most that is taken: {hint}"
    )


def _slips(number: float, unit: str, bounds: tuple[float, float]) -> list[str]:
    """Other units in which the number would be one that is tried."""
    others = [("°", math.pi / 180)] if unit == "rad" else []
    if unit in SMALLER:
        others.append((f" {SMALLER[unit][0]}", 1e-3))
    return [
        f"{number:g}{other} ({number * factor:.3g})"
        for other, factor in others
        if bounds[0] <= number * factor <= bounds[1]
    ]


def _check_possible(name: str, p: Parameter, number: float) -> None:
    """Beyond a fit's bounds a value may lie, but no factor below 0, no infinite addition, no probability above 1."""
    lowest = min(low for low, _ in p.bounds)
    if math.isinf(number) and p.identity != number:
        raise ValueError(f"effect {name!r}: {p.name} is {number}, give a finite number")
    if number < 0 <= lowest or number == 0 < lowest:
        raise ValueError(
            f"effect {name!r}: {p.name} is {number:g}, give a number {'above' if lowest else 'of at least'} 0"
        )
    if p.possible is not None and not p.possible[0] <= number <= p.possible[1]:
        low, high = p.possible
        raise ValueError(f"effect {name!r}: {p.name} is {number:g}, give a number from {low:g} to {high:g}")


def _check_detail(name: str, detail: Detail, number: float) -> None:
    low, high = (FAR * bound for bound in detail.bounds)
    if not low <= number <= high:
        unit = " or ".join(dict.fromkeys(detail.unit))
        raise ValueError(
            f"effect {name!r}: {detail.name} is {number:g} {unit}, give a number from {low:g} to {high:g} {unit}"
        )
