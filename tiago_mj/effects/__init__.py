"""The effects that a simulator may lack: one declaration each, in the order of the signal chain."""

from tiago_mj.effects import (  # noqa: F401  (their import declares the effects)
    actuator,
    body,
    command,
    contact,
    force_sensor,
    joint_sensor,
    mount,
    timing,
    transmission,
)
from tiago_mj.effects.declare import EFFECTS, Effect, effect
from tiago_mj.effects.describe import Description, describe
from tiago_mj.effects.fields import Parameter, parameter
from tiago_mj.effects.nominal import check_entries
from tiago_mj.effects.spec import Entry, read_effects

__all__ = [
    "EFFECTS",
    "Description",
    "Effect",
    "Entry",
    "Parameter",
    "check_entries",
    "describe",
    "effect",
    "parameter",
    "read_effects",
]
