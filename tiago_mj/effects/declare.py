"""What an effect is: a name, a stage of the signal chain, parameters with an identity value, and what it does.

An effect is declared once, as a class, and serves the environments (``effects=``) and the diagnosis alike:

    @effect("force_gain", stage="force_sensor", targets="sensor", gap_class="gain")
    class ForceGain(Effect):
        \"\"\"The load cell's gain is not the nominal one.

        Formula: reading = factor · x
        \"\"\"

        factor = parameter("-", identity=1.0, default=1.3, bounds=(0.3, 3.0))

        def reading(self, reading, now):
            return reading * self.factor

A user's own is declared in the same way, anywhere; docs/effects.md is made of the docstrings, whose labelled
paragraphs are listed in :mod:`tiago_mj.effects.describe`; reports tell the one on where to look on the robot.

An instance holds the parameters of many simulations at once: ``self.factor`` is (nsim, ntargets). Hooks take and return
arrays of that shape, once per control step (``added_friction``, ``added_damping``, ``added_force``, ``servo_force``,
``force_range`` once per physics step). What an effect has to remember it keeps in attributes made in
:meth:`Effect.start`, which is called at every reset. Where an effect is at its identity the chain takes the hook's
input instead of its output, so that it changes nothing, to the last bit.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Final, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import checks
from tiago_mj.effects.fields import Detail, Form, NominalPrior, Parameter
from tiago_mj.effects.now import Now, Wiring
from tiago_mj.effects.tendons import Tendon

Array = NDArray[np.float64]

#: In the order of the signal chain; within a stage effects act in the order of their declaration.
STAGES: Final = (
    "timing",
    "command",
    "actuator",
    "transmission",
    "contact",
    "body",
    "joint_sensor",
    "force_sensor",
)
TARGETS: Final = ("command", "joint", "sensor", "object", "clock")

#: What is so of one effect, and not of those that are built on it.
NOT_INHERITED: Final = (
    "clause",
    "clause_less",
    "nominal_prior",
    "shows_as",
    "twins",
    "resembles",
    "taken_up_by",
    "loses_commands",
)
#: Hooks that any effect may have, beside those whose arrays have the shape of its targets.
COMMON_HOOKS: Final = ("start", "change", "place", "model_attributes", "model_tendons")
HOOKS: Final = {
    "command": ("command", "set_point", "given", "servo_force", "force_range", "measure_effort"),
    "joint": (
        "set_point",
        "added_friction",
        "added_damping",
        "added_force",
        "servo_force",
        "force_range",
        "measure_position",
        "true_position",
        "measure_velocity",
    ),
    "sensor": ("contact_force", "reading", "noise", "sample"),
}
#: The diagnosis applies effects of these stages to motions that it has simulated before: they may only measure.
MEASURING: Final = {
    "joint_sensor": ("start", "measure_position", "true_position", "measure_velocity"),
    "force_sensor": ("start", "contact_force", "reading", "noise", "sample"),
}


class Effect:
    """Base of every effect. A declaration overrides the hooks of its stage and leaves the others.

    A hook as it stands here changes nothing, so that a declaration may build on it by ``super()``. Within a control
    step only hooks that :func:`overrides` finds overridden are called.
    """

    name: ClassVar[str]
    stage: ClassVar[str]
    targets: ClassVar[str]
    gap_class: ClassVar[str]
    parameters: ClassVar[Mapping[str, Parameter]]
    forms: ClassVar[Mapping[str, Form]]
    details: ClassVar[Mapping[str, Detail]]
    #: What is different about the robot, as a report tells a reader who has never seen the effect's name: a clause in
    #: which ``{p}`` is the parameter p with unit and interval, ``{p%}`` the same in per cent, ``{t}`` the targets, and
    #: ``{s}``, ``{is}`` and ``{has}`` agree with them. What stands in brackets is left out where the parameter in it is
    #: 0. Empty: it is told by its name.
    clause: ClassVar[str] = ""
    #: The same where the first parameter is negative, which is then written without its sign.
    clause_less: ClassVar[str] = ""
    #: Whom the clause speaks of where the effect is given to all its targets; empty: every one of them.
    subject: ClassVar[str] = ""
    #: Real effects have not quite the form that is declared of them: they may differ by this share of what they change.
    #: Without it the rest of a large effect is taken for another one.
    form_known_to: ClassVar[float] = 0.03
    #: Whether its hooks ask for nothing but the signal that they are given and the time: then nobody has to look at the
    #: joints between two physics steps, and the diagnosis simulates a whole run in one go.
    signal_only: ClassVar[bool] = False
    #: Kind of the readings (``position``, ``velocity`` or ``force``) that it rounds to a grid of its first parameter's
    #: step, and does nothing else to; None: none. A reading on a grid is compared with what was not rounded.
    rounds: ClassVar[str | None] = None
    #: What readings show of it by themselves, and how large it is: one of
    #: :data:`tiago_mj.effects.checks.SYMPTOMS`; empty: it is fitted.
    shows_as: ClassVar[str] = ""
    #: Names of effects that do nearly the same to many recordings, declared on one of each two.
    twins: ClassVar[tuple[str, ...]] = ()
    #: Names of effects of another class that do nearly the same where motions are slow, declared on one of each two:
    #: beside a further effect each is tried in the other's place.
    resembles: ClassVar[tuple[str, ...]] = ()
    #: Names of effects whose nominal numbers may take up a part of what it does: it is sought without them, too.
    taken_up_by: ClassVar[tuple[str, ...]] = ()
    #: Whether commands are lost to it, the one before staying in force: which ones is decoded from the servos' motion.
    loses_commands: ClassVar[bool] = False
    #: Name of the parameter that is the period of a ripple over the joint's position, which no gradient leads to: it is
    #: read off what the nominal model leaves. Empty: it has none.
    ripple_period: ClassVar[str] = ""
    #: Name of the parameter that is the frequency at which joints swing once they are pushed, read off alike. Empty: it
    #: has none.
    swing_frequency: ClassVar[str] = ""
    #: Whether it is the same whichever of its targets it is given to, such as a mass at the tool that all joints feel.
    common: ClassVar[bool] = False
    #: Whether it changes what a servo does with its set point: a motor without a servo cannot have it.
    needs_servo: ClassVar[bool] = False
    #: Whether one of its targets ``object`` must be there; what is everywhere, such as gravity, needs none.
    needs_object: ClassVar[bool] = True
    #: Whether it acts on its target and on the joint that carries that, as a motor does that turns with both: it is
    #: sought on one joint at a time, and a joint that none carries cannot have it.
    reaches_carrier: ClassVar[bool] = False
    #: Fewest targets that it can act between.
    fewest_targets: ClassVar[int] = 1
    #: What of the nominal model a negative first parameter takes away, and at most all of it, by its name in
    #: :data:`tiago_mj.effects.nominal.STOCKS`; None where it takes nothing.
    takes_from: ClassVar[str | None] = None
    #: How well the nominal model's own number is known that the first parameter changes: every explanation of a gap may
    #: adjust it, and the effect is named only where it goes beyond. A model's numbers are known to about 4 % where
    #: nothing says more. None: it has none, or that is known exactly.
    nominal_prior: ClassVar[NominalPrior | None] = None
    #: The same of a user's own model, whose commands are replayed; None: ``nominal_prior``.
    own_model_prior: ClassVar[NominalPrior | None] = None
    #: The same where measured efforts are compared with the torques that a motion needs; None: ``nominal_prior``.
    effort_prior: ClassVar[NominalPrior | None] = None
    #: The same there of a number that counts as exact until the recordings say otherwise: see
    #: :mod:`tiago_mj.gap.torque.doubts`. None: it is never doubted.
    doubted_prior: ClassVar[NominalPrior | None] = None
    #: Name of the parameter by which all that is measured of the motion is late, against commands and efforts; empty:
    #: it is not.
    delays_readings: ClassVar[str] = ""
    #: Whether what it does is drawn at random: no simulation repeats it, so that known as it is it closes no gap.
    by_chance: ClassVar[bool] = False
    #: Hooks that have something to do only where a detail of that name is given.
    by_detail: ClassVar[Mapping[str, str]] = {}
    #: Whether a diagnosis may name it; what no robot has, but simulators differ in, is only adjusted.
    nameable: ClassVar[bool] = True

    def __init__(self, values: Mapping[str, Array], targets: Sequence[str] = ()) -> None:
        for key, value in values.items():
            setattr(self, key, value)
        self.target_names = tuple(targets)

    @property
    def present(self) -> NDArray[np.bool_]:
        """Where the effect is not at its identity, (nsim, ntargets)."""
        switches = [p for p in self.parameters.values() if p.identity is not None]
        present: NDArray[np.bool_] = np.logical_or.reduce([getattr(self, p.name) != p.identity for p in switches])
        return present

    @property
    def reach(self) -> NDArray[np.bool_]:
        """Where its hooks may change something, (nsim, ntargets), or (nsim, 1) where that is anywhere."""
        present = self.present
        anywhere = self.reaches_carrier or self.common
        return np.atleast_2d(present.any(axis=1, keepdims=True)) if anywhere else present

    @classmethod
    def has_nominal_number(cls, model: mujoco.MjModel, wiring: Wiring, index: int) -> bool:
        """Whether what it changes of a target, by its index, is no number that another effect changes alike: of those
        one is uncertain where commands are replayed."""
        return True

    def start(self, now: Now) -> None:
        """Forget the episode before."""

    # What it does; a declaration overrides the hooks that it needs, in the order in which they are called.

    def change(self, now: Now) -> None:
        """Change the model, once per reset, through ``now.host.field(name)``, which holds nominal values before."""

    def model_attributes(self, now: Now) -> Mapping[str, Array] | None:
        """Attributes of the actuators' elements in a model file by which MuJoCo does the same, by their names in MJCF,
        each (nsim, nactuators); None: there are none. Not asked where :meth:`change` is all that the effect does."""
        return None

    def model_tendons(self, now: Now) -> Sequence[Tendon] | None:
        """Fixed tendons in a model file by which MuJoCo does the same, of the first simulation; None: there are none.
        Not asked where :meth:`change` is all that the effect does."""
        return None

    def contact_factors(self, factors: Array, now: Now) -> Array:
        """Factors on stiffness, damping and virtual mass of pad and object's contact, once per reset, (nsim, 3); those
        that hold."""
        return factors

    def place(self, now: Now) -> None:
        """Change the initial state, once per reset, through ``now.host.state(name)``."""

    def command(self, command: Array, now: Now) -> Array:
        """The command as sent, (nsim, nactuators) in the interface's unit; what arrives."""
        return command

    def set_point(self, target: Array, now: Now) -> Array:
        """The servo's set point as commanded, (nsim, nactuators) [m, rad]; the one that it takes."""
        return target

    def given(self, inputs: Array, now: Now) -> Array:
        """What the servos would be given in each physics step of the control period, (nsim, nsubsteps, nactuators):
        speeds of set points, set points or forces, as the actuator takes them; what they are given."""
        return inputs

    def added_friction(self, now: Now) -> Array:
        """Dry friction to add before a physics step, (nsim, njoints) [N, N·m]; its sign is whatever opposes motion."""
        return np.zeros((now.nsim, len(now.wiring.dof)))

    def added_damping(self, now: Now) -> Array:
        """Viscous damping to add before a physics step, (nsim, njoints) [N·s/m, N·m·s/rad]."""
        return np.zeros((now.nsim, len(now.wiring.dof)))

    def added_force(self, now: Now) -> Array:
        """Force on the joints to add before a physics step, (nsim, njoints) [N, N·m]."""
        return np.zeros((now.nsim, len(now.wiring.dof)))

    def measure_effort(self, effort: Array) -> Array:
        """Efforts of the actuators' joints, (T, nactuators) [N, N·m]; what a recording says of them, which takes the
        nominal drive's word for it. Only where efforts are compared along a motion, with one simulation."""
        return effort

    def servo_force(self, now: Now) -> Array:
        """Force that the servos add to their own, within their limits, before a physics step, (nsim, nactuators)
        [N, N·m at the actuator]."""
        return np.zeros((now.nsim, len(now.wiring.actuators)))

    def force_range(self, limits: Array, now: Now) -> Array:
        """Limits of the servos' forces before a physics step, (nsim, nactuators, 2) [N, N·m]; those that hold."""
        return limits

    def measure_position(self, position: Array, now: Now) -> Array:
        """Joint positions, (nsim, njoints) [m, rad]; as measured."""
        return position

    def true_position(self, measured: Array, now: Now) -> Array:
        """Joint positions as measured at rest, (nsim, njoints) [m, rad]; where they are. A replay starts there."""
        return measured

    def measure_velocity(self, velocity: Array, now: Now) -> Array:
        """Joint velocities, (nsim, njoints) [m/s, rad/s]; as measured."""
        return velocity

    def contact_force(self, newtons: Array, now: Now) -> Array:
        """Force on the pads, (nsim, nsensors) [N]; the one that reaches the load cells."""
        return newtons

    def reading(self, reading: Array, now: Now) -> Array:
        """Load-cell signal before noise, (nsim, nsensors) [sensor units]; as the cell gives it."""
        return reading

    def noise(self, noise: Array, now: Now) -> Array:
        """Noise to be added to the signal, (nsim, nsensors) [sensor units]."""
        return noise

    def sample(self, sample: Array, now: Now) -> Array:
        """Signal with noise, (nsim, nsensors) [sensor units]; as it arrives in the computer."""
        return sample


EFFECTS: Final[dict[str, type[Effect]]] = {}

E = TypeVar("E", bound=type[Effect])


def effect(name: str, *, stage: str, targets: str, gap_class: str | None = None) -> Callable[[E], E]:
    """Register a declaration under ``name``, for ``effects=`` and as a candidate of the diagnosis.

    Args:
        name: as in ``effects=`` and ``diagnosis.json``: small letters, digits, underscores.
        stage: one of :data:`STAGES`.
        targets: one of :data:`TARGETS`.
        gap_class: groups effects that many recordings cannot tell apart; its own name if None.

    Raises:
        ValueError: the name is taken, or the declaration could not work; one line. The same class declared again (a
            module that is imported anew, a notebook's cell that is run again) takes the place of the one before.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise ValueError(f"effect {name!r}: write the name in small letters, digits and underscores")
    if stage not in STAGES:
        raise ValueError(f"effect {name!r}: stage {stage!r} is unknown: use one of {', '.join(STAGES)}")
    if targets not in TARGETS:
        raise ValueError(f"effect {name!r}: targets {targets!r} is unknown: use one of {', '.join(TARGETS)}")

    def register(declared: E) -> E:
        known = EFFECTS.get(name)
        if known is not None and (known.__module__, known.__qualname__) != (declared.__module__, declared.__qualname__):
            raise ValueError(
                f"effect {name!r} is already declared, by {known.__module__}.{known.__qualname__}: choose another name"
            )
        if not (isinstance(declared, type) and issubclass(declared, Effect)):
            raise ValueError(f"effect {name!r}: declare a class that derives from Effect")
        inherited = {key: value for cls in reversed(declared.__mro__) for key, value in vars(cls).items()}
        parameters = {key: value for key, value in inherited.items() if isinstance(value, Parameter)}
        checks.check_parameters(name, parameters, (*dir(Effect), *Effect.__annotations__, "target_names"))
        declared.forms = {key: value for key, value in inherited.items() if isinstance(value, Form)}
        declared.details = {key: value for key, value in inherited.items() if isinstance(value, Detail)}
        for key in NOT_INHERITED:
            setattr(declared, key, vars(declared).get(key, getattr(Effect, key)))
        _check_hooks(name, declared, stage, targets)
        checks.check_symptom(name, declared)
        checks.check_taken(name, declared.takes_from, targets, next(iter(parameters.values())))
        checks.check_prior(name, declared, targets, next(iter(parameters.values())))
        checks.check_clauses(name, declared, (*parameters, *checks.GRAMMAR))
        declared.name, declared.stage, declared.targets = name, stage, targets
        declared.gap_class = gap_class or name
        declared.parameters = parameters
        EFFECTS[name] = declared
        return declared

    return register


def _check_hooks(name: str, declared: type[Effect], stage: str, targets: str) -> None:
    own = [hook for hook in _ALL_HOOKS if overrides(declared, hook)]
    if not set(own) - {"start", "model_attributes", "model_tendons"}:
        raise ValueError(f"effect {name!r} does nothing: give it one of {', '.join(_ALL_HOOKS)}")
    possible = (*COMMON_HOOKS, *HOOKS.get(targets, _ALL_HOOKS))
    for hook in own:
        if hook not in possible:
            raise ValueError(
                f"effect {name!r} has the hook {hook}, which targets={targets!r} cannot reach: "
                f"use {', '.join(possible)}"
            )
        if hook not in MEASURING.get(stage, possible):
            raise ValueError(
                f"effect {name!r} has the hook {hook}, but in stage {stage!r} it may only measure: "
                f"use {', '.join(MEASURING[stage])}, or an earlier stage"
            )
        takes, given = (len(inspect.signature(getattr(cls, hook)).parameters) for cls in (Effect, declared))
        if takes != given:
            asked = ", ".join(inspect.signature(getattr(Effect, hook)).parameters)
            raise ValueError(f"effect {name!r}: {hook} takes {given} arguments, write {hook}({asked})")


def twins(name: str) -> tuple[str, ...]:
    """Names of an effect's twins (:attr:`Effect.twins`), be they declared on it or on them."""
    return tuple(other for other, one in EFFECTS.items() if other in EFFECTS[name].twins or name in one.twins)


def resembling(name: str) -> frozenset[str]:
    """Names of the effects that may stand in an effect's place: its twins, those that it resembles
    (:attr:`Effect.resembles`), and theirs."""
    found, ends = {name}, {name}
    while ends:
        near = {other for one in ends for other in twins(one)}
        near |= {
            other
            for one in ends
            for other, it in EFFECTS.items()
            if other in EFFECTS[one].resembles or one in it.resembles
        }
        ends = near - found
        found |= ends
    return frozenset(found - {name})


def is_random(declared: type[Effect]) -> bool:
    """Whether an effect is predicted by the mean over draws: it draws at random, and not only a noise, whose mean is
    0."""
    return declared.by_chance and not overrides(declared, "noise")


def only_measures(declared: type[Effect]) -> bool:
    """Whether an effect acts on readings alone, so that the motion is the nominal one and begins where that does."""
    measuring = {hook for hooks in MEASURING.values() for hook in hooks} - {"true_position"}
    return measuring.issuperset(hook for hook in _ALL_HOOKS if overrides(declared, hook))


def overrides(declared: type[Effect] | Effect, hook: str) -> bool:
    """Whether a declaration has its own version of a hook."""
    cls = declared if isinstance(declared, type) else type(declared)
    return getattr(cls, hook) is not getattr(Effect, hook)


_ALL_HOOKS: Final = tuple(key for key, value in vars(Effect).items() if inspect.isfunction(value) and key[0] != "_")
