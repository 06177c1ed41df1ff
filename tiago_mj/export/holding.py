"""Which effects a target can hold: every effect acts on one quantity, and a target says how it has each quantity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.declare import STAGES

Grade = Literal["exact", "approximate", "not"]


@dataclass(frozen=True)
class Held:
    """How a target holds a quantity.

    Attributes:
        grade: ``exact`` (the same number in the same law), ``approximate`` or ``not``.
        how: in which form, or why not.
    """

    grade: Grade
    how: str


#: What an effect acts on; an effect that is not listed, such as a user's own, acts on its stage.
QUANTITIES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "command_delay": "delay",
        "dropped_commands": "lost commands",
        "command_lag": "command filter",
        "rate_limit": "set-point speed",
        "command_deadband": "set-point steps",
        "command_quantization": "set-point steps",
        "servo_stiffness": "servo stiffness",
        "servo_damping": "servo damping",
        "force_limit": "effort limit",
        "torque_constant": "motor constant",
        "motor_cogging": "cogging",
        "velocity_limit": "velocity limit",
        "coulomb_friction": "dry friction",
        "viscous_friction": "viscous friction",
        "stribeck_friction": "changing friction",
        "load_dependent_friction": "changing friction",
        "asymmetric_friction": "friction by direction",
        "coupled_motor_friction": "coupled motor",
        "coupled_motor_damping": "coupled motor",
        "backlash": "play",
        "joint_elasticity": "elasticity",
        "joint_spring": "spring",
        "armature": "armature",
        "coupling_error": "coupling",
        "payload": "mass",
        "gravity_tilt": "gravity",
        "compliant_mount": "mount",
    }
)


def exact(how: str) -> Held:
    """Held as it is."""
    return Held("exact", how)


def approximate(how: str) -> Held:
    """Held in another form."""
    return Held("approximate", how)


def lacking(why: str) -> Held:
    """Not held."""
    return Held("not", why)


#: What no simulator's files hold, with where it can be had.
NOWHERE: Final[Mapping[str, Held]] = MappingProxyType(
    {
        "timing": lacking("stamps are the recorder's: shift them where logs are compared"),
        "lost commands": lacking("drawn at random: drop commands in the loop that sends them"),
        "command filter": lacking("filter commands in the loop that sends them"),
        "set-point speed": lacking("limit the speed of set points in the loop that sends them"),
        "set-point steps": lacking("round commands in the loop that sends them"),
        "spring": lacking("a force by position, to be applied in each step"),
        "cogging": lacking("a force by position, to be applied in each step"),
        "changing friction": lacking("friction is one number there"),
        "friction by direction": lacking("friction is one number there"),
        "coupled motor": lacking("a motor of two joints: a tendon or a force over both, to be written by hand"),
        "mount": lacking("two hinges with springs below the base, to be written by hand"),
        "coupling": lacking("set points of one joint on another: add them in the loop that sends them"),
        "contact": lacking("of the grasped object, which is not part of the robot"),
        "joint_sensor": lacking("readings are made by the observation: change them there"),
        "force_sensor": lacking("readings are made by the observation: change them there"),
    }
)


def quantity(effect: str) -> str:
    """What an effect acts on."""
    return QUANTITIES.get(effect, EFFECTS[effect].stage)


def held(holds: Mapping[str, Held], effect: str) -> Held:
    """How a target holds an effect.

    Args:
        holds: how the target has each quantity; what it does not list it lacks.
        effect: its name.
    """
    acts_on = quantity(effect)
    if acts_on in holds:
        return holds[acts_on]
    return NOWHERE.get(acts_on, lacking("the format has no place for it"))


#: Of a target without domain randomisation.
ONE_NUMBER: Final = lacking("the format has one number for each: it is written as it was fitted")


def randomised(drawn: Mapping[str, Held], effect: str) -> Held:
    """How a target's domain randomisation has an effect.

    Args:
        drawn: how it has each quantity; empty: it has none.
        effect: its name.
    """
    if not drawn:
        return ONE_NUMBER
    return drawn.get(quantity(effect), lacking("no number of the robot's model: it is not drawn there"))


def library() -> list[str]:
    """Effects of this package that a diagnosis may name, in the order of the signal chain."""
    own = [name for name, one in EFFECTS.items() if one.nameable and one.__module__.startswith("tiago_mj.effects")]
    return sorted(own, key=lambda name: STAGES.index(EFFECTS[name].stage))


def table(targets: Mapping[str, Mapping[str, Held]], effects: Sequence[str]) -> str:
    """Effects × targets as a table of Markdown, with notes on how each quantity is held.

    Args:
        targets: how each has each quantity, by name.
        effects: rows.
    """
    signs = {"exact": "exact", "approximate": "approx.", "not": "–"}
    lines = [
        "| effect | " + " | ".join(f"`{name}`" for name in targets) + " |",
        "|---" * (len(targets) + 1) + "|",
    ]
    for effect in effects:
        row = [signs[held(holds, effect).grade] for holds in targets.values()]
        lines.append(f"| `{effect}` | " + " | ".join(row) + " |")
    return "\n".join(lines) + "\n"


def reasons(targets: Mapping[str, Mapping[str, Held]], effects: Sequence[str]) -> str:
    """How each quantity is held, and why not, as lists of Markdown."""
    lines: list[str] = []
    for name, holds in targets.items():
        by_how: dict[tuple[Grade, str], list[str]] = {}
        for effect in effects:
            one = held(holds, effect)
            by_how.setdefault((one.grade, one.how), []).append(f"`{effect}`")
        lines += [f"### `{name}`", ""]
        titles = {"exact": "Exact", "approximate": "Approximate", "not": "Not held"}
        for grade, title in titles.items():
            lines += [f"- {title}: {', '.join(own)}: {how}." for (g, how), own in by_how.items() if g == grade]
        lines.append("")
    return "\n".join(lines)
