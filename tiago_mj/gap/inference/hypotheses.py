"""What may explain a gap: which effect, on which targets, at which magnitudes; and what every explanation may adjust.

Nuisance parameters are the nominal model's own numbers, known to a few percent: an effect is only named when what it
needs goes beyond them. They are effects too, at small magnitudes, with a normal prior.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.nominal import STOCKS, Seen, known_to_some_percent, prior_of, removable
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.sizes import Size
from tiago_mj.recordings.nominal_priors import deviation

#: Targets from which on an effect with a magnitude of its own on each counts as one effect: two may be two
#: accidents, as of a finger that rubs and another that was mended; what all joints of an arm have is how its gears
#: are. Halved and doubled, none of 16 answers about efforts changes (varied_efforts.json).
GROUP: Final = 3

Array = NDArray[np.float64]
#: Effect and targets, None for all.
Label = tuple[str, tuple[str, ...] | None]

#: Magnitudes tried on either side of the identity when screening, as shares of the way to the bound. Halved and
#: doubled, none of 16 answers about hinges changes (varied.json).
GRID_SHARES: Final = (0.02, 0.1, 0.5)
#: What ends at infinity and may be more than so many times as large as at least is tried evenly in its logarithm,
#: each magnitude so many times the next. Halved and doubled, none of 32 answers about hinges changes (varied.json).
DECADES: Final = 50.0
STIFFNESS_RATIO: Final = 4.0
#: The prior density of a magnitude is flat below this share of the bound. Halved and doubled, none of 16 answers
#: about hinges changes (varied.json).
FLAT_PRIOR_SHARE: Final = 0.01
#: A magnitude counts as at its bound where it is closer to it than this share of the range. Halved and doubled, none
#: of 16 answers about hinges changes (varied.json).
EDGE_SHARE: Final = 1e-3
#: Share of the known uncertainty of an effect's form that the magnitude takes up. With it, and deviations of the fit
#: widened 1.87 times, true magnitudes of 166 hinges have even ranks in posteriors of Student's form with 1.5 degrees of
#: freedom (chi-square's p 0.61), and 89 % of the 90 % intervals hold them (benchmarks/results/magnitudes.json).
FORM_COMPENSATION: Final = 0.16
#: Number of values of a second parameter that recordings can distinguish; its logarithm is the prior penalty for
#: having chosen one. Halved and doubled, none of 16 answers about hinges changes (varied.json).
SECOND_PARAMETER_VALUES: Final = 10


@dataclass(frozen=True)
class Candidate:
    """One effect on one choice of targets, with all but one parameter fixed.

    Attributes:
        effect: name.
        target: names, or None for all.
        parameter: the one that is fitted.
        fixed: the others.
        identity, low, high: of the parameter.
        grid: magnitudes of the first pass.
        unit: of the parameter.
        tolerance: two deviations of the nominal model's own number of that kind; 0 if it has none.
        spread: one standard deviation of a magnitude that a detector measured and whose curvature says nothing; else
            None.
        removes: ``low`` takes away all that the nominal model has of it.
        selection_penalty: per trial, the penalty for having chosen the realization of a random effect (lost commands)
            with the recordings at hand [nats per fully weighted sample]; empty where nothing was chosen.
    """

    effect: str
    target: tuple[str, ...] | None
    parameter: str
    fixed: tuple[tuple[str, float], ...]
    identity: float
    low: float
    high: float
    grid: tuple[float, ...]
    unit: str
    tolerance: float = 0.0
    spread: float | None = None
    removes: bool = False
    selection_penalty: tuple[float, ...] = ()

    def entry(self, value: float) -> Entry:
        """The effect at a magnitude."""
        return Entry(self.effect, self.target, {self.parameter: value, **dict(self.fixed)})

    def log_prior(self, value: float) -> float:
        """Log of the prior density of a magnitude, per unit of it.

        Nobody knows an effect's order of magnitude: the density falls as one over the magnitude, down to what the
        nominal model's own number is uncertain by or a hundredth of the bound, and is flat below. Limits have no
        magnitude: they may lie anywhere between their bounds. A second number, or a form, that was chosen among
        others has its share.
        """
        forms, details = EFFECTS[self.effect].forms, EFFECTS[self.effect].details
        chosen = sum(
            np.log(len(forms[name].values) if name in forms else SECOND_PARAMETER_VALUES)
            for name, _ in self.fixed
            if name not in details or details[name].usual is None  # those have priors of their own
        )
        if _is_stiffness(self.identity, self.low, self.high):  # of any order of magnitude
            return -float(np.log(value * np.log(self.high / self.low)) + chosen)
        if not np.isfinite(self.identity):
            return -float(np.log(self.high - self.low) + chosen)
        sides = [abs(bound - self.identity) for bound in (self.low, self.high)]
        least = max(self.tolerance, max(sides) * FLAT_PRIOR_SHARE)
        whole = sum(np.log1p(side / least) for side in sides)
        return -float(np.log(whole * (abs(value - self.identity) + least)) + chosen)

    def known_to(self, value: float) -> float:
        """Systematic standard deviation of a magnitude, in its unit, which recordings cannot reduce: the uncertainty of
        the form of the effect. That of the nominal number to which it adds is none: a magnitude is what differs from
        that number, and the sum is what recordings show."""
        return form_deviation(self.effect, self.identity, value)

    def at_edge(self, value: float) -> bool:
        """Whether a magnitude lies at a bound of what is possible, and not where the effect, or what the nominal model
        has of it, just vanishes."""
        stiff = _is_stiffness(self.identity, self.low, self.high)
        near = EDGE_SHARE * (self.low if stiff else self.high - self.low)
        at_least = value < self.low + near and not self.removes and self.low != self.identity
        return at_least or (value > self.high - near and self.high > self.identity)

    def moved(self, value: float, step: float) -> float:
        """A magnitude after a step, within its bounds. What yields does so in proportion to one over its stiffness: a
        stiffness takes the step that this takes to first order."""
        if _is_stiffness(self.identity, self.low, self.high):
            yields = 1 - step / value
            value = value / yields if yields > 0 else self.high
        else:
            value += step
        return min(max(value, self.low), self.high)

    def room(self, value: float) -> tuple[float, float]:
        """Steps down and up by which a magnitude comes to its bounds, see :meth:`moved`."""
        stiff = _is_stiffness(self.identity, self.low, self.high)
        down, up = ((value * (1 - value / b) if stiff else b - value) for b in (self.low, self.high))
        return down, up

    @property
    def second_numbers(self) -> dict[str, float]:
        """How far the logarithms of the fixed numbers may range that act gradually, by name: of forms, of what has a
        prior of its own, and of what is tried at a few values only there is none."""
        parameters = EFFECTS[self.effect].parameters
        return {
            name: max(math.log(high / low) for low, high in parameters[name].bounds)
            for name, value in self.fixed
            if name in parameters and not parameters[name].tried and value
        }

    @property
    def label(self) -> Label:
        """Effect and targets."""
        return self.effect, self.target


def number_of_effects(labels: Iterable[Label]) -> int:
    """How many effects labels are: one that is on :data:`GROUP` of its targets, on each by its own, is one."""
    times = Counter(effect for effect, _ in labels)
    return sum(1 if count >= GROUP else count for count in times.values())


def form_deviation(effect: str, identity: float, value: float) -> float:
    """Standard deviation of a magnitude due to the uncertain form of its effect, in its unit; 0 for a limit."""
    return FORM_COMPENSATION * EFFECTS[effect].form_known_to * abs(value - identity) if np.isfinite(identity) else 0.0


def candidates(
    plant: Plant,
    names: Iterable[str] | None = None,
    fastest: Array | None = None,
    sizes: Sequence[Size] | None = None,
) -> tuple[Candidate, ...]:
    """Every effect of the library that the plant can have, on all targets and on each.

    Args:
        plant: the nominal simulator.
        names: effects; None for all.
        fastest: of the joints in the nominal replay, (njoints,): a limit of the speed of a joint that has none would
            show below.
        sizes: of the joints, (njoints,), where magnitudes must be sought that fit them; None: the library's own.
    """
    out: list[Candidate] = []
    tolerances = _tolerances(plant)
    for name in EFFECTS if names is None else names:
        declared = EFFECTS[name]
        kind = declared.targets
        targets = plant.wiring.targets.names(kind)
        if not declared.nameable or not _possible(plant, name, targets):
            continue
        choices: list[tuple[str, ...] | None] = [None]
        if kind in ("command", "joint", "sensor") and len(targets) > 1 and not declared.common:
            choices += [(target,) for target in targets]
        if declared.reaches_carrier:
            choices = [(targets[k],) for k, carrier in enumerate(plant.wiring.carrier) if carrier >= 0]
        for choice in choices:
            index = 0 if choice is None else targets.index(choice[0])
            tolerance = max(
                (d for (e, t), d in tolerances.items() if e == name and (choice or (t,))[0] == t), default=0.0
            )
            size = None if sizes is None or kind not in ("command", "joint") else sizes[_joint(plant, kind, index)]
            out += [
                replace(c, tolerance=2 * tolerance) for c in _candidates_of(plant, name, choice, index, fastest, size)
            ]
    return tuple(out)


def _tolerances(plant: Plant) -> dict[tuple[str, str | None], float]:
    """Deviation of the nominal model's own number of each kind, by effect and target."""
    return {(t.effect, None if t.target is None else t.target[0]): abs(t.deviation) for t in terms(plant)}


def _possible(plant: Plant, name: str, targets: tuple[str, ...]) -> bool:
    """Whether the plant has what the effect acts on."""
    declared = EFFECTS[name]
    if not targets:
        return False
    if declared.targets == "object" and declared.needs_object:
        return plant.wiring.object_body is not None
    if declared.stage == "force_sensor":
        return plant.cell is not None
    if declared.needs_servo and (plant.wiring.interface == "effort" or not plant.wiring.servo.any()):
        return False
    if declared.reaches_carrier and (plant.wiring.carrier < 0).all():
        return False
    return len(targets) >= declared.fewest_targets


def _joint(plant: Plant, kind: str, index: int) -> int:
    """Index of the joint of a target."""
    return plant.wiring.targets.actuated[index] if kind == "command" else index


def _candidates_of(
    plant: Plant,
    name: str,
    target: tuple[str, ...] | None,
    index: int,
    fastest: Array | None,
    size: Size | None,
) -> list[Candidate]:
    declared = EFFECTS[name]
    kind = declared.targets
    targets = plant.wiring.targets
    side = targets.side(kind, index)
    switch = next(p for p in declared.parameters.values() if p.identity is not None)
    scale = 1.0
    if switch.nominal is not None:
        scale = targets.nominal(switch.nominal, kind, index)
        if not np.isfinite(scale) and switch.nominal == "velocity" and fastest is not None:
            scale = float(fastest[_joint(plant, kind, index)])
        if not np.isfinite(scale) or scale == 0:
            return []
    low, high = (bound * scale for bound in switch.bounds[side])
    assert switch.identity is not None
    if size is not None:
        low, high = size.within(switch, low, high)
    removes = False
    if declared.takes_from is not None:
        all_of_it = -removable(declared, plant.model, plant.wiring, index)
        low, removes = max(low, all_of_it), all_of_it >= low and STOCKS[declared.takes_from].vanishes
    grid = _magnitudes(switch.identity, low, high)
    others = [p for p in declared.parameters.values() if p is not switch]
    settings: list[tuple[tuple[str, float], ...]] = [()]
    for other in others:
        a, b = other.bounds[side]
        default = other.default[side]
        values = other.tried or (default, float(np.sqrt(a * default)), float(np.sqrt(b * default)))
        settings = [(*setting, (other.name, value)) for setting in settings for value in values]
    for form in declared.forms.values():
        settings = [(*setting, (form.name, value)) for setting in settings for value in form.values]
    return [
        Candidate(
            name, target, switch.name, setting, switch.identity, low, high, grid, switch.unit[side], removes=removes
        )
        for setting in settings
    ]


def _is_stiffness(identity: float, low: float, high: float) -> bool:
    """Whether a magnitude is one over a yield, and not a limit: it ends at infinity and may be of any decade."""
    return not np.isfinite(identity) and low > 0 and high / low > DECADES


def _magnitudes(identity: float, low: float, high: float) -> tuple[float, ...]:
    """Values on both sides of the identity, closer together near it."""
    if _is_stiffness(identity, low, high):  # evenly in its logarithm
        count = int(np.ceil(np.log(high / low) / np.log(STIFFNESS_RATIO))) + 1
        return tuple(np.geomspace(high, low, count).tolist())
    if not np.isfinite(identity):  # a limit: from loose to tight
        return tuple(float(low + (high - low) * share) for share in (1.0, 0.6, 0.3, 0.12, 0.05))
    if identity == 1.0 and low > 0:  # a factor: evenly in its logarithm
        up = [float(np.exp(np.log(high) * share)) for share in (0.05, 0.2, 0.6)]
        down = [float(np.exp(np.log(low) * share)) for share in (0.05, 0.2, 0.6)]
        return (*reversed(down), *up)
    up = [identity + (high - identity) * share for share in GRID_SHARES] if high > identity else []
    down = [identity + (low - identity) * share for share in GRID_SHARES] if low < identity else []
    return (*reversed(down), *up)


@dataclass(frozen=True)
class Term:
    """One nuisance parameter of a plant: what its value in deviations means.

    Attributes:
        effect, target, parameter: what it changes.
        nominal: value at 0.
        deviation: change of the value at +1, signed; of a factor, of its logarithm: a third is as far off as thrice.
        per_trial: whether every trial has its own.
        low, high: bounds of the value.
    """

    effect: str
    target: tuple[str, ...] | None
    parameter: str
    nominal: float
    deviation: float
    per_trial: bool
    low: float = -np.inf
    high: float = np.inf

    def entry(self, deviations: float) -> Entry:
        """The effect at so many deviations, within what it can be."""
        move = deviations * self.deviation
        value = self.nominal * np.exp(move) if self.factor else self.nominal + move
        return Entry(self.effect, self.target, {self.parameter: min(max(float(value), self.low), self.high)})

    def deviations(self, value: float) -> float:
        """How far a value is off."""
        return float((np.log(value / self.nominal) if self.factor else value - self.nominal) / self.deviation)

    @property
    def factor(self) -> bool:
        """Whether the parameter multiplies what the model has: its deviations are then of its logarithm."""
        return EFFECTS[self.effect].parameters[self.parameter].identity == 1.0


@dataclass(frozen=True)
class OwnNumber(Term):
    """A number of an effect itself beside its magnitude: it counts wherever that effect is part of an explanation.

    Attributes:
        usual: by target, values at 0.
        of_logarithm: whether deviations are of its logarithm.
    """

    usual: tuple[tuple[str, float], ...] = ()
    of_logarithm: bool = False

    @property
    def factor(self) -> bool:
        """Whether deviations are of its logarithm."""
        return self.of_logarithm

    def of(self, target: tuple[str, ...] | None, deviations: float) -> float:
        """The number for the effect on some targets, at so many deviations from the mean of what is usual for them."""
        values = np.array([value for name, value in self.usual if target is None or name in target])
        move = deviations * self.deviation
        value = np.exp(np.log(values).mean() + move) if self.factor else values.mean() + move
        return float(np.clip(value, self.low, self.high))

    def spread(self, target: tuple[str, ...] | None, deviations: float, deviation: float) -> float:
        """Its standard deviation there, if it is known to so many deviations."""
        return self.deviation * deviation * (self.of(target, deviations) if self.factor else 1.0)


def own_numbers(plant: Plant, effects: Iterable[str]) -> tuple[OwnNumber, ...]:
    """Numbers of some effects that are fitted with their magnitudes where commands are replayed.

    What is a share of a joint's inertia, of your own models only: in the project's environments a motor has none, and
    the audit at the truth meets grasps and arms without one (docs/truth-audit.md).
    """
    if plant.effort_row is not None:
        return ()
    out = []
    for name in dict.fromkeys(effects):
        declared = EFFECTS[name]
        for detail in declared.details.values():
            prior = detail.usual
            if prior is None or (prior.share_of is not None and plant.environment is not None):
                continue
            names = plant.wiring.targets.names(declared.targets)
            scales = {one: 1.0 if prior.share_of is None else _scale(plant, one, prior.share_of) for one in names}
            usual = tuple((one, prior.middle * scale) for one, scale in scales.items() if scale)
            if usual:
                side = plant.wiring.targets.side(declared.targets, names.index(usual[0][0]))
                size, log = prior.deviation_on(side), prior.of_logarithm
                found = OwnNumber(name, None, detail.name, 0.0, size, False, *detail.bounds, usual, log)
                out.append(replace(found, nominal=found.of(None, 0.0)))
    return tuple(out)


def _scale(plant: Plant, joint: str, share_of: str) -> float:
    """Of what a detail is a share, for a joint [kg, kg·m²; N·s/m, N·m·s/rad]; 0 where it has no servo."""
    index = plant.wiring.targets.joint.index(joint)
    if index not in plant.wiring.targets.actuated:
        return 0.0
    inertia = _inertia(plant, index)
    if share_of == "inertia":
        return inertia
    actuator = plant.wiring.actuators[plant.wiring.targets.actuated.index(index)]
    stiffness = -float(plant.model.actuator_biasprm[actuator, 1] * plant.model.actuator_gear[actuator, 0] ** 2)
    return 2 * float(np.sqrt(max(stiffness, 0.0) * inertia))


def terms(plant: Plant) -> tuple[Term, ...]:
    """The nuisance parameters of a plant; where its recordings say how well a number is known, that counts."""
    stated = [term for name in dict.fromkeys(name for name, _ in plant.known) for term in _stated_terms(plant, name)]
    said = {(term.effect, target) for term in stated for target in term.target or (None,)}
    usual = _default_terms(plant)
    return (*(t for t in usual if not any((t.effect, target) in said for target in t.target or (None,))), *stated)


def _stated_terms(plant: Plant, name: str) -> list[Term]:
    """What recordings say of one effect's first parameter."""
    declared = EFFECTS[name]
    targets = plant.wiring.targets
    names = targets.names(declared.targets)
    parameter = next(p for p in declared.parameters.values() if p.identity is not None)
    if not _possible(plant, name, names) or parameter.identity is None or not np.isfinite(parameter.identity):
        return []
    single = declared.common or declared.targets in ("object", "clock")
    out = []
    for group in [None] if single else [(target,) for target in names]:
        size = deviation(plant.known, name, None if group is None else group[0])
        if declared.common:  # whichever target it is stated of
            size = max(d for (effect, _), d in plant.known.items() if effect == name)
        if size is not None:
            index = targets.first(declared.targets, group)
            low, high = parameter.bounds[targets.side(declared.targets, index)]
            low = max(low, -removable(declared, plant.model, plant.wiring, index))
            out.append(Term(name, group, parameter.name, parameter.identity, size, False, low, high))
    return out


def _default_terms(plant: Plant) -> tuple[Term, ...]:
    """Those of any nominal model."""
    out: list[Term] = []
    targets = plant.wiring.targets
    seen = Seen(plant.environment is None, plant.effort_row is not None, plant.doubted)
    for declared in known_to_some_percent(seen):
        names, prior = targets.names(declared.targets), prior_of(declared, seen)
        if prior is None or not _possible(plant, declared.name, names):
            continue
        parameter = next(p for p in declared.parameters.values() if p.identity is not None)
        single = declared.common or declared.targets in ("object", "clock") or not prior.each
        for group in [None] if single else [(name,) for name in names]:
            index = targets.first(declared.targets, group)
            if not seen.efforts and not declared.has_nominal_number(plant.model, plant.wiring, index):
                continue
            size = prior.deviation[targets.side(declared.targets, index)]
            base = parameter.identity
            if prior.share_of == "stock":
                size *= removable(declared, plant.model, plant.wiring, index)
            elif prior.share_of == "inertia":
                size *= _inertia(plant, index)
            elif prior.share_of == "row":
                size *= plant.effort_row or plant.period
            elif prior.share_of == "effort":
                size *= plant.largest_effort[index] if plant.largest_effort else 0.0
            elif prior.share_of == "reach":
                size *= _reach(plant, index)
            elif prior.share_of == "limit" and parameter.nominal is not None:
                base = targets.nominal(parameter.nominal, declared.targets, index)
                size *= -base  # the response is of a tighter one, which is seen where the looser one is not yet
            if size and base is not None and np.isfinite(base):
                low = -removable(declared, plant.model, plant.wiring, index)
                out.append(Term(declared.name, group, parameter.name, base, size, prior.per_trial, low))
    return tuple(out)


def _inertia(plant: Plant, joint: int) -> float:
    """What the joint moves, at the start [kg, kg·m²]."""
    return float(plant.model.dof_M0[plant.wiring.dof[joint]])


def _reach(plant: Plant, joint: int) -> float:
    """From a joint to the farthest of its body's centre of mass and the bodies that hang on that [m]."""
    model, body = plant.model, int(plant.model.dof_bodyid[plant.wiring.dof[joint]])
    anchor = model.jnt_pos[model.dof_jntid[plant.wiring.dof[joint]]]
    ends = [model.body_ipos[body], *model.body_pos[np.flatnonzero(model.body_parentid == body)]]
    return float(max(np.linalg.norm(end - anchor) for end in ends))
