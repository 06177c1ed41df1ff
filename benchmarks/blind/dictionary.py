"""Which effects a case may have, how large, and how their parameters compare with the library's.

Names, units and classes are the contract's. A range reaches from barely visible to large; magnitudes are drawn
log-uniformly in it. ``MAPPING`` says in words which of the generator's parameters are the contract's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from benchmarks.blind.effects import commands, coupled, friction, gears, sensors, springs, things, unknown
from benchmarks.blind.effects.base import Effect

GRIPPER, ARM, PLAIN, SIX = "gripper", "arm", "plain", "six"
#: A setting without ranges of its own has those of one that is about as large.
AS_LARGE_AS: Final = {SIX: ARM}


@dataclass(frozen=True)
class Kind:
    """An effect that a case may have.

    Attributes:
        make: its class.
        on: ``joint``, ``sensor`` or ``none`` (no target of its own).
        ranges: setting: parameter: (low, high); two numbers, drawn log-uniformly. A negative low draws the sign, too:
            (-low, high) is the range of the magnitude. A factor's range lies on one side of 1 and is given as
            (least, most distance from 1) under ``factor`` with ``below`` or ``above``.
        group: class of the contract.
        known: whether the library has it.
        soft_form_of: effect of the library of which it is a softer form.
    """

    make: type[Effect]
    on: str
    ranges: Mapping[str, Mapping[str, tuple[Any, ...]]]
    group: str = ""
    known: bool = True
    soft_form_of: str = ""
    fixed: Mapping[str, Any] = field(default_factory=dict)


def _r(gripper: Any = None, arm: Any = None, plain: Any = None) -> dict[str, Any]:
    given = {GRIPPER: gripper, ARM: arm, PLAIN: plain}
    return {key: value for key, value in given.items() if value is not None}


def _same(**ranges: Any) -> dict[str, Any]:
    return _r(ranges, ranges, ranges)


LOG, BELOW, ABOVE, SIGNED, FACTOR, FLAT = "log", "below", "above", "signed", "factor", "flat"

KINDS: Final[Mapping[str, Kind]] = {
    "command_delay": Kind(commands.CommandDelay, "joint", _same(seconds=(LOG, 0.004, 0.12)), "delay"),
    "clock_offset": Kind(sensors.ClockOffset, "none", _same(seconds=(LOG, 0.004, 0.12)), "delay"),
    "clock_skew": Kind(sensors.ClockSkew, "none", _same(rate=(LOG, 0.001, 0.03))),
    "dropped_commands": Kind(commands.DroppedCommands, "joint", _same(probability=(LOG, 0.02, 0.3))),
    "command_lag": Kind(commands.CommandLag, "joint", _same(time_constant=(LOG, 0.008, 0.2)), "lag"),
    "rate_limit": Kind(
        commands.RateLimit,
        "joint",
        _r({"velocity": (LOG, 0.008, 0.045)}, {"velocity": (LOG, 0.15, 0.8)}, {"velocity": (LOG, 0.4, 3.0)}),
    ),
    "command_deadband": Kind(
        commands.CommandDeadband,
        "joint",
        _r({"width": (LOG, 1e-4, 2e-3)}, {"width": (LOG, 1e-3, 2e-2)}, {"width": (LOG, 5e-3, 5e-2)}),
    ),
    "command_quantization": Kind(
        commands.CommandQuantization,
        "joint",
        _r({"step": (LOG, 1e-4, 2e-3)}, {"step": (LOG, 1e-3, 3e-2)}, {"step": (LOG, 5e-3, 6e-2)}),
    ),
    "servo_stiffness": Kind(commands.ServoStiffness, "joint", _same(factor=(BELOW, 0.1, 0.7)), "gain"),
    "servo_damping": Kind(
        commands.ServoDamping,
        "joint",
        _r({"damping": (LOG, 8, 160)}, {"damping": (LOG, 5, 150)}, {"damping": (LOG, 0.1, 2.0)}),
        "damping",
    ),
    "force_limit": Kind(
        commands.ForceLimit,
        "joint",
        _r({"limit": (LOG, 2.5, 10.0)}, {"limit": (LOG, 4.0, 20.0)}, {"limit": (LOG, 0.8, 2.5)}),
    ),
    "velocity_limit": Kind(
        commands.VelocityLimit,
        "joint",
        _r({"velocity": (LOG, 0.008, 0.045)}, {"velocity": (LOG, 0.15, 0.8)}, {"velocity": (LOG, 0.4, 3.0)}),
    ),
    "torque_constant": Kind(commands.TorqueConstant, "joint", _same(factor=(BELOW, 0.1, 0.6)), "gain"),
    "motor_cogging": Kind(
        commands.MotorCogging,
        "joint",
        _r(
            {"amplitude": (LOG, 0.1, 3.0), "period": (LOG, 0.003, 0.012)},
            {"amplitude": (LOG, 0.5, 10.0), "period": (LOG, 0.05, 0.4)},
            {"amplitude": (LOG, 0.05, 0.6), "period": (LOG, 0.1, 0.6)},
        ),
    ),
    "coulomb_friction": Kind(
        friction.CoulombFriction,
        "joint",
        _r({"force": (LOG, 0.2, 5.0)}, {"force": (LOG, 0.5, 8.0)}, {"force": (LOG, 0.02, 0.5)}),
        "friction",
    ),
    "viscous_friction": Kind(
        friction.ViscousFriction,
        "joint",
        _r({"damping": (LOG, 8, 160)}, {"damping": (LOG, 5, 150)}, {"damping": (LOG, 0.1, 2.0)}),
        "damping",
    ),
    "stribeck_friction": Kind(
        friction.StribeckFriction,
        "joint",
        _r(
            {"static": (LOG, 0.5, 5.0), "velocity": (LOG, 0.005, 0.02)},
            {"static": (LOG, 1.0, 8.0), "velocity": (LOG, 0.03, 0.15)},
            {"static": (LOG, 0.05, 0.5), "velocity": (LOG, 0.1, 0.4)},
        ),
        "friction",
    ),
    "load_dependent_friction": Kind(
        friction.LoadDependentFriction, "joint", _same(coefficient=(LOG, 0.04, 0.4)), "friction"
    ),
    "asymmetric_friction": Kind(
        friction.AsymmetricFriction,
        "joint",
        _r({"force": (SIGNED, 0.3, 5.0)}, {"force": (SIGNED, 0.5, 8.0)}, {"force": (SIGNED, 0.02, 0.5)}),
    ),
    "backlash": Kind(
        gears.Backlash,
        "joint",
        _r({"width": (LOG, 1e-4, 3e-3)}, {"width": (LOG, 1e-3, 3e-2)}, {"width": (LOG, 4e-3, 0.1)}),
        "play",
    ),
    "joint_elasticity": Kind(
        gears.JointElasticity,
        "joint",
        _r({"stiffness": (LOG, 800, 15000)}, {"stiffness": (LOG, 800, 15000)}, {"stiffness": (LOG, 10, 150)}),
        "gain",
    ),
    "armature": Kind(
        commands.Armature,
        "joint",
        _r({"mass": (LOG, 0.1, 2.0)}, {"mass": (LOG, 0.1, 3.0)}, {"mass": (LOG, 0.004, 0.08)}),
    ),
    "coupling_error": Kind(commands.CouplingError, "joint", _r({"ratio": (LOG, 0.01, 0.25)})),
    "payload": Kind(things.Payload, "none", _r(None, {"mass": (LOG, 0.1, 2.0)}, {"mass": (LOG, 0.03, 0.4)})),
    "gravity_tilt": Kind(things.GravityTilt, "none", _r({"angle": (LOG, 0.03, 0.25)})),
    "contact_stiffness": Kind(things.ContactStiffness, "none", _r({"factor": (FACTOR, 0.1, 0.8)})),
    "contact_damping": Kind(things.ContactDamping, "none", _r({"factor": (FACTOR, 0.4, 5.0)})),
    "contact_friction": Kind(things.ContactFriction, "none", _r({"factor": (BELOW, 0.3, 0.9)})),
    "object_size": Kind(things.ObjectSize, "none", _r({"radius": (SIGNED, 2e-4, 5e-3)}), "geometry"),
    "object_offset": Kind(things.ObjectOffset, "none", _r({"distance": (SIGNED, 8e-4, 8e-3)}), "geometry"),
    "object_mass": Kind(things.ObjectMass, "none", _r({"factor": (ABOVE, 0.3, 3.0)})),
    "pad_creep": Kind(
        sensors.PadCreep, "sensor", _r({"fraction": (LOG, 0.03, 0.4), "time_constant": (LOG, 0.15, 1.0)})
    ),
    "encoder_bias": Kind(
        sensors.EncoderBias,
        "joint",
        _r({"offset": (SIGNED, 5e-5, 3e-3)}, {"offset": (SIGNED, 3e-4, 3e-2)}, {"offset": (SIGNED, 2e-3, 6e-2)}),
    ),
    "encoder_scale": Kind(sensors.EncoderScale, "joint", _same(factor=(FACTOR, 0.004, 0.12))),
    "encoder_quantization": Kind(
        sensors.EncoderQuantization,
        "joint",
        _r({"step": (LOG, 1e-4, 2e-3)}, {"step": (LOG, 5e-4, 1e-2)}, {"step": (LOG, 3e-3, 5e-2)}),
    ),
    "velocity_filter": Kind(sensors.VelocityFilter, "joint", _same(time_constant=(LOG, 0.01, 0.25))),
    "force_bias": Kind(sensors.ForceBias, "sensor", _r({"offset": (SIGNED, 0.004, 0.4)})),
    "force_gain": Kind(sensors.ForceGain, "sensor", _r({"factor": (FACTOR, 0.08, 0.6)}), "gain"),
    "force_nonlinearity": Kind(sensors.ForceNonlinearity, "sensor", _r({"quadratic": (SIGNED, 0.02, 0.3)})),
    "force_drift": Kind(sensors.ForceDrift, "sensor", _r({"rate": (SIGNED, 0.002, 0.15)})),
    "force_lag": Kind(sensors.ForceLag, "sensor", _r({"time_constant": (LOG, 0.008, 0.25)}), "lag of force"),
    "force_delay": Kind(sensors.ForceDelay, "sensor", _r({"seconds": (LOG, 0.006, 0.15)}), "lag of force"),
    "force_hysteresis": Kind(sensors.ForceHysteresis, "sensor", _r({"width": (LOG, 0.02, 0.5)})),
    "force_crosstalk": Kind(sensors.ForceCrosstalk, "sensor", _r({"ratio": (LOG, 0.02, 0.35)})),
    "force_saturation": Kind(sensors.ForceSaturation, "sensor", _r({"limit": (LOG, 0.4, 1.4)})),
    "force_dead_zone": Kind(sensors.ForceDeadZone, "sensor", _r({"width": (LOG, 0.015, 0.3)})),
    "force_quantization": Kind(sensors.ForceQuantization, "sensor", _r({"step": (LOG, 0.02, 0.2)})),
    "force_noise": Kind(sensors.ForceNoise, "sensor", _r({"factor": (ABOVE, 0.4, 5.0)})),
    "force_dropout": Kind(sensors.ForceDropout, "sensor", _r({"probability": (LOG, 0.02, 0.3)})),
    # Outside the library.
    "thermal_fade": Kind(
        unknown.ThermalFade,
        "joint",
        _r(
            {"heating": (LOG, 1.0, 12.0), "time_constant": (FLAT, 1.5, 5.0)},
            None,
            {"heating": (LOG, 0.5, 20.0), "time_constant": (FLAT, 1.5, 5.0)},
        ),
        known=False,
    ),
    "cable_tug": Kind(
        unknown.CableTug,
        "joint",
        _r(
            {"stiffness": (LOG, 40, 800), "place": (FLAT, 0.55, 0.95)},
            {"stiffness": (LOG, 20, 200), "place": (FLAT, 0.5, 0.8)},
            {"stiffness": (LOG, 0.5, 4.0), "place": (FLAT, 0.4, 0.6)},
        ),
        known=False,
    ),
    "place_friction": Kind(
        unknown.PlaceFriction,
        "joint",
        _r(
            {"force": (LOG, 0.8, 8.0), "place": (FLAT, 0.5, 0.9), "width": (FLAT, 0.04, 0.12)},
            {"force": (LOG, 2.0, 15.0), "place": (FLAT, 0.4, 0.6), "width": (FLAT, 0.02, 0.06)},
            {"force": (LOG, 0.1, 1.0), "place": (FLAT, 0.4, 0.6), "width": (FLAT, 0.04, 0.12)},
        ),
        known=False,
    ),
    "stiffening_spring": Kind(
        unknown.StiffeningSpring,
        "joint",
        _r({"force": (LOG, 3.0, 40.0)}, {"force": (LOG, 5.0, 40.0)}, {"force": (LOG, 0.5, 5.0)}),
        known=False,
        soft_form_of="joint_spring",
    ),
    "mains_hum": Kind(
        unknown.MainsHum,
        "sensor",
        _r({"amplitude": (LOG, 0.015, 0.2), "frequency": (FLAT, 50.15, 60.0)}),
        known=False,
    ),
    "mount_resonance": Kind(
        unknown.MountResonance,
        "joint",
        _r({"strength": (LOG, 0.3, 1.2), "frequency": (FLAT, 5.0, 10.0)}),
        known=False,
    ),
    "supply_sag": Kind(
        unknown.SupplySag, "joint", _r({"current": (LOG, 4.0, 16.0)}), known=False, soft_form_of="force_limit"
    ),
    "sticky_pads": Kind(unknown.StickyPads, "sensor", _r({"share": (LOG, 0.15, 1.0)}), known=False),
    "soft_saturation": Kind(
        unknown.SoftSaturation,
        "sensor",
        _r({"limit": (LOG, 0.6, 2.5)}),
        known=False,
        soft_form_of="force_saturation",
    ),
    "late_stamps": Kind(
        unknown.LateStamps,
        "none",
        _same(seconds=(LOG, 0.008, 0.12), period=(FLAT, 0.8, 2.0)),
        known=False,
    ),
}

#: Effects of the library that no drawn case has, as only an arm of several joints can have them, or as cases were drawn
#: before they were in it: they are asked for.
ON_REQUEST: Final[Mapping[str, Kind]] = {
    "coupled_motor_friction": Kind(coupled.CoupledMotorFriction, "joint", {SIX: {"force": (LOG, 0.5, 8.0)}}),
    "coupled_motor_damping": Kind(coupled.CoupledMotorDamping, "joint", {SIX: {"damping": (LOG, 0.3, 8.0)}}),
    "joint_spring": Kind(
        springs.ReturnSpring,
        "joint",
        _r(
            {"stiffness": (LOG, 20, 400), "slack": (FLAT, 0.0, 1.0)},
            {"stiffness": (LOG, 2, 40), "slack": (FLAT, 0.0, 1.0)},
            {"stiffness": (LOG, 0.2, 4.0), "slack": (FLAT, 0.0, 1.0)},
        ),
    ),
}

KNOWN: Final = tuple(name for name, kind in KINDS.items() if kind.known)
UNKNOWN: Final = tuple(name for name, kind in KINDS.items() if not kind.known)
#: All of the library that a name may be.
LIBRARY: Final = (*KNOWN, *ON_REQUEST)

#: What is shared between the generator's parameters and the contract's, and what only resembles it. A parameter that is
#: in none of them is the contract's number. ``None`` is not scored.
MAPPING: Final[Mapping[str, Mapping[str, str | None]]] = {
    "command_lag": {"time_constant": "two poles of half of it each: the same delay of slow signals as the contract's"},
    "velocity_filter": {"time_constant": "as command_lag"},
    "force_lag": {"time_constant": "as command_lag"},
    "pad_creep": {
        "fraction": "the whole relaxed part",
        "time_constant": "mean of two, 0.7 and 1.4 of it; not scored: None of them is the contract's",
    },
    "force_hysteresis": {"width": "mean full width of five plays"},
    "stribeck_friction": {"static": "at rest", "velocity": "of a Gaussian bell; not scored, as the shape is free"},
    "motor_cogging": {"amplitude": "of the first harmonic", "period": "the same"},
    "backlash": {"width": "full play"},
    "joint_spring": {"slack": "where it is slack, as a share of the joint's range; not scored"},
}
#: Numbers that the library knows of an effect, and no case draws: how often reality's drivers look at set points [s],
#: the share of cogging's second harmonic, how far the widths of a load cell's plays are spread, how soon a drive's
#: profile has its speed, over which time it takes a velocity from its encoder, how soon a gear gives [s], how far apart
#: rubber's two time constants are, 0.7 and 1.4 of the drawn one.
CONSTANT: Final[Mapping[str, Mapping[str, float]]] = {
    "command_deadband": {"period": 0.005},
    "command_quantization": {"period": 1e-4},
    "rate_limit": {"ramp": 0.002},
    "servo_damping": {"filter": 0.002},
    "load_dependent_friction": {"lag": 0.005},
    "motor_cogging": {"second": 0.1},
    "force_hysteresis": {"spread": 0.6},
    "pad_creep": {"spread": 1 / 3},
}
UNSCORED: Final = frozenset(
    {("pad_creep", "time_constant"), ("stribeck_friction", "velocity"), ("joint_spring", "slack")}
)


def available(setting: str, *, known: bool = True) -> list[str]:
    """Names of the effects that make sense in a setting."""
    return [name for name in (KNOWN if known else UNKNOWN) if setting in KINDS[name].ranges]


def ranges(name: str, setting: str) -> Mapping[str, tuple[Any, ...]]:
    """How an effect's parameters are drawn in a setting; empty where it makes no sense there."""
    known = kind_of(name).ranges
    return known.get(setting) or known.get(AS_LARGE_AS.get(setting, setting), {})


def kind_of(name: str) -> Kind:
    """An effect's, be it drawn or asked for."""
    return KINDS[name] if name in KINDS else ON_REQUEST[name]


def draw(name: str, setting: str, rng: np.random.Generator) -> dict[str, float]:
    """Parameters of an effect."""
    out = {}
    for parameter, (how, low, high) in ranges(name, setting).items():
        size = float(rng.uniform(low, high) if how == FLAT else np.exp(rng.uniform(np.log(low), np.log(high))))
        sign = 1.0 if rng.random() < 0.5 else -1.0
        if how == BELOW:
            size = 1 - size
        elif how == ABOVE:
            size = 1 + size
        elif how == FACTOR:
            size = 1 + size if sign > 0 else 1 / (1 + size)
        elif how == SIGNED:
            size *= sign
        out[parameter] = float(f"{size:.6g}")
    return out
