"""Effects as a user writes them: a list, the short form, or a calibration file; and as entries that are checked."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from numpy.typing import NDArray

from tiago_mj.gap.effects.declare import EFFECTS, Effect, Parameter

Array = NDArray[np.float64]

SCHEMA: Final = "tiago_mj.calibration/1"


@dataclass(frozen=True)
class Entry:
    """One effect on its targets. Parameters left out take their defaults.

    Attributes:
        name: of the effect.
        target: names of actuators, joints or sensors; None is all of them.
        parameters: by name.
    """

    name: str
    target: tuple[str, ...] | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)

    def __hash__(self) -> int:
        return hash((self.name, self.target, tuple(sorted(self.parameters.items()))))


@dataclass(frozen=True)
class Targets:
    """What an entry can name, and the nominal limits that relative defaults refer to.

    Attributes:
        command, joint, sensor: names, in the order of the arrays.
        slides: of the joints, whether each slides (else it turns).
        velocity, effort: nominal limits of the actuators [m/s, rad/s], [N, N·m]; inf where there is none.
        actuated: per actuator, the index of its joint.
    """

    command: tuple[str, ...]
    joint: tuple[str, ...]
    sensor: tuple[str, ...]
    slides: tuple[bool, ...]
    velocity: Array
    effort: Array
    actuated: tuple[int, ...]

    def names(self, kind: str) -> tuple[str, ...]:
        """Of one kind of target."""
        return {"command": self.command, "joint": self.joint, "sensor": self.sensor}.get(kind, (kind,))

    def slide(self, kind: str, index: int) -> bool:
        """Whether that target is on a sliding joint."""
        if kind == "command":
            return self.slides[self.actuated[index]]
        return self.slides[index] if kind == "joint" else True

    def nominal(self, quantity: str, kind: str, index: int) -> float:
        """The limit that a relative parameter is a share of."""
        limits = self.velocity if quantity == "velocity" else self.effort
        if kind == "command":
            return float(limits[index])
        return float(limits[self.actuated.index(index)]) if index in self.actuated else math.inf


def read_effects(given: Any) -> tuple[Entry, ...]:
    """Entries of what a user gave.

    Args:
        given: None, a list of ``{"name", "target", "parameters"}``, a mapping ``{name: parameters}`` (target all;
        ``{}``
            means the defaults), a list of :class:`Entry`, the path of a calibration YAML, or JSON text of the above.

    Raises:
        ValueError: an unknown effect or parameter, a value that is no finite number, a file of another schema; one
        line.
    """
    if given is None:
        return ()
    if isinstance(given, (str, Path)):
        given = _load(given)
    if isinstance(given, Mapping):
        if "schema" in given:
            if given["schema"] != SCHEMA:
                raise ValueError(f"calibration has schema {given['schema']!r}: this version reads {SCHEMA!r}")
            given = given.get("effects") or []
        else:
            given = [{"name": name, "parameters": parameters} for name, parameters in given.items()]
    if not isinstance(given, Sequence):
        raise ValueError(
            f"effects are {type(given).__name__}: give a list, a mapping name to parameters, or a YAML file"
        )
    return tuple(item if isinstance(item, Entry) else _entry(item) for item in given)


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
    values |= {key: np.full((len(sims), len(names)), form.values[0]) for key, form in declared.forms.items()}
    for sim, entries in enumerate(sims):
        for entry in entries:
            if entry.name != declared.name:
                continue
            for index in _reach(entry, declared, names):
                for key, p in declared.parameters.items():
                    slide = targets.slide(declared.targets, index)
                    default = p.default[0 if slide else 1]
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


def _reach(entry: Entry, declared: type[Effect], names: tuple[str, ...]) -> list[int]:
    if entry.target is None:
        return [len(names) - 1] if declared.name == "payload" else list(range(len(names)))
    unknown = [name for name in entry.target if name not in names]
    if unknown:
        raise ValueError(
            f"effect {entry.name!r} has target {unknown[0]!r}: this robot's {declared.targets} targets are "
            f"{', '.join(names) or 'none'}"
        )
    return [names.index(name) for name in entry.target]


def _entry(item: Any) -> Entry:
    if not isinstance(item, Mapping) or "name" not in item:
        raise ValueError(f"effect {item!r} has no name: write {{'name': ..., 'target': ..., 'parameters': {{...}}}}")
    name = item["name"]
    if name not in EFFECTS:
        raise ValueError(f"effect {name!r} is unknown: use one of {', '.join(EFFECTS)}")
    unknown = set(item) - {"name", "target", "parameters"}
    if unknown:
        raise ValueError(f"effect {name!r} has an unknown key {sorted(unknown)[0]!r}: use name, target, parameters")
    target = item.get("target", "all")
    if isinstance(target, str):
        target = None if target == "all" else (target,)
    elif not (isinstance(target, Sequence) and target and all(isinstance(t, str) for t in target)):
        raise ValueError(f"effect {name!r} has target {target!r}: give a name, a list of names, or 'all'")
    parameters = item.get("parameters") or {}
    if not isinstance(parameters, Mapping):
        raise ValueError(f"effect {name!r} has parameters {parameters!r}: give a mapping of names to numbers")
    declared, forms = EFFECTS[name].parameters, EFFECTS[name].forms
    values = {}
    for key, value in parameters.items():
        if key not in declared and key not in forms:
            raise ValueError(f"effect {name!r} has no parameter {key!r}: use {', '.join(declared)}")
        number = value.get("value") if isinstance(value, Mapping) else value  # a calibration carries low and high too
        if isinstance(number, bool) or not isinstance(number, (int, float, np.number)) or math.isnan(number):
            raise ValueError(f"effect {name!r}: {key} is {number!r}, give a number")
        if key in declared:
            _check_possible(name, declared[key], float(number))
        elif number not in forms[key].values:
            possible = ", ".join(f"{one:g}" for one in forms[key].values)
            raise ValueError(f"effect {name!r}: {key} is {number:g}, use one of {possible}")
        values[key] = float(number)
    return Entry(name, None if target is None else tuple(target), values)


def _check_possible(name: str, p: Parameter, number: float) -> None:
    """Beyond a fit's bounds a value may lie, but no factor below 0, no infinite addition, no probability above 1."""
    lowest = min(low for low, _ in p.bounds)
    if math.isinf(number) and p.identity != number:
        raise ValueError(f"effect {name!r}: {p.name} is {number}, give a finite number")
    if number < 0 <= lowest or number == 0 < lowest:
        raise ValueError(
            f"effect {name!r}: {p.name} is {number:g}, give a number {'above' if lowest else 'of at least'} 0"
        )
    if p.name == "probability" and number > 1:
        raise ValueError(f"effect {name!r}: {p.name} is {number:g}, give a number from 0 to 1")


def _load(source: str | Path) -> Any:
    text = str(source)
    if isinstance(source, str) and text.lstrip().startswith(("{", "[")):
        try:
            return json.loads(text)
        except json.JSONDecodeError as fault:
            raise ValueError(f"effects are no valid JSON: {fault}") from fault
    path = Path(source)
    if not path.is_file():
        raise ValueError(f"no calibration file {text!r}: give the path of a calibration.yaml, or effects as JSON")
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as fault:
        raise ValueError(f"calibration {path.name} is no valid YAML: {' '.join(str(fault).split())}") from fault
