"""A Dynamixel XL330-M288-T that swings 0.49 kg at 0.10 m, at four gains (Rhoban/bam): one motor, one truth.

Torque is made of PWM, supply voltage and speed by the data sheet's line, whose scale is known to 30 %; regressions
therefore fit the scale along, against the weighed pendulum. Friction grows with the torque that the motor gives.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.real import signals
from benchmarks.real.declare import (
    COMMANDS,
    EFFORTS,
    NOTHING,
    REGISTER,
    REGRESSION,
    SEMI,
    WHOLE,
    Case,
    Cause,
    File,
    Source,
)
from benchmarks.real.logs import Array, Log, log
from tiago_mj.recordings.imports import xl330

JOINT: Final = xl330.JOINT
MASS, LENGTH, VOLTS = 0.49, 0.1, 7.4
_HIGH: Final = {
    "2026-01-15_10h29m14.json": "016d15d21c464457aa30eaeab3977228b08cd5acf7542f24067440126c0bf480",
    "2026-01-15_10h29m21.json": "fe68cff62e976c87a2fcab925a517fbff83be16c862693310fdc1eff743eddab",
    "2026-01-15_10h29m29.json": "b9ce9fc0f396e6b03bd514e9254cb83b8a64e1a5df1728b9a10e3b4a5a9513ca",
    "2026-01-15_10h29m37.json": "838d390b7190c4ce1608157cf629989648773b7336728a0931a61c6018c6700b",
    "2026-01-15_10h29m47.json": "61ae8eeb881be5d8c09f6c7fba4cef39f66b1ff03e0148ef3bc0e314054513f5",
    "2026-01-15_10h29m54.json": "b50055742ee553a8cb849b38d04d2b9bcf7143d0acefe6539f922984b93d958a",
    "2026-01-15_10h30m02.json": "040e065f9885833fa909683f13665f90048ce5457d94dd2a3af056c21c36210d",
    "2026-01-15_10h30m10.json": "01d32db99e7859f012a230aca59f1dda24219d6781472d356861b138526213e6",
}
SOURCE: Final = Source(
    "xl330",
    xl330.DATA.repository,
    xl330.DATA.commit,
    xl330.DATA.licence,
    tuple(
        File(f"{folder}/{name}", f"{xl330.DATA.path}/{name}", digest)
        for folder, names in (("xl330_pendulum", xl330.DATA.sha256), ("xl330_pendulum_high_gain", _HIGH))
        for name, digest in names.items()
    ),
)
_PLACES: Final = tuple(file.place for file in SOURCE.files)
#: By the servo's gain register: four trajectories each.
AT_GAIN: Final = {gain: _PLACES[4 * k : 4 * k + 4] for k, gain in enumerate((100, 200, 400, 800))}
#: Over all gains, by regression: of the motor's torque [–], [kg·m²], [N·m·s/rad].
BY_LOAD, ARMATURE, VISCOUS = 0.35, 0.0019, 0.0067


def _runs(data: Path, places: Sequence[str]) -> list[xl330.Run]:
    return [xl330.read_run(data / place) for place in places]


def torques(data: Path, places: Sequence[str]) -> list[Log]:
    """Position [rad] and torque [N·m]; no command."""
    made = []
    for run in _runs(data, places):
        position = run.columns["position"]
        made.append(
            log(
                f"{run.facts['trajectory']}-kp{run.facts['kp']:g}",
                run.columns["timestamp"],
                position={JOINT: position},
                effort={JOINT: run.torque},
                uncertainty={"torque_constant": xl330.TORQUE_KNOWN_TO},
                initial={"position": {JOINT: float(position[0])}},
            )
        )
    return made


def goals(data: Path, places: Sequence[str]) -> list[Log]:
    """Goal and position [rad], until the torque is switched off; no effort."""
    made = []
    for run in _runs(data, places):
        on = run.columns["torque_enable"] > 0
        rows = slice(0, len(on) if on.all() else int(np.argmin(on)))
        position, goal = run.columns["position"][rows], run.columns["goal_position"][rows]
        made.append(
            log(
                f"{run.facts['trajectory']}-kp{run.facts['kp']:g}",
                run.columns["timestamp"][rows],
                command={JOINT: goal},
                position={JOINT: position},
                interface="position",
                initial={"position": {JOINT: float(position[0])}, "set_point": {JOINT: float(goal[0])}},
            )
        )
    return made


def model(*, gain: int | None = None, moves: bool = False) -> str:
    """The pendulum, with a motor or with the servo at a gain.

    Args:
        gain: of the servo's register; None: the command is a torque.
        moves: with the motor's own inertia and viscous friction.
    """
    per_volt = xl330.STALL_TORQUE / xl330.AT_VOLTS
    servo: dict[str, Any] = {}
    if gain is not None:
        stiffness = gain * xl330.PWM_PER_RADIAN / xl330.FULL_PWM * VOLTS * per_volt
        servo = {"stiffness": stiffness, "damping": per_volt * xl330.BACK_EMF}
    text = xl330.pendulum(MASS, LENGTH, **servo)
    own = f' armature="{ARMATURE}" damping="{VISCOUS}"' if moves else ""
    return text.replace(f'<joint name="{JOINT}" axis="0 -1 0"/>', f'<joint name="{JOINT}" axis="0 -1 0"{own}/>')


def motor(data: Path, places: Sequence[str]) -> dict[str, float]:
    """Inertia and friction of the motor at some gains, the scale of its torque fitted along."""
    columns: list[Array] = []
    for run in _runs(data, places):
        time = run.columns["timestamp"]
        saturated = np.abs(run.pwm) >= xl330.FULL_PWM - 1
        beside = np.stack([run.torque, run.columns["torque_enable"] > 0, saturated], axis=1).astype(np.float64)
        motion = signals.motion(time, run.columns["position"][:, None], beside, rate=200.0, cutoff=8.0)
        speed = motion.velocity[:, 0]
        near = np.ones(21)
        use = np.abs(speed) > 0.15  # dry friction has no direction at rest
        use &= np.convolve(motion.beside[:, 2] > 0.05, near, "same") < 0.5
        use &= np.convolve(np.abs(np.gradient(motion.beside[:, 1])) > 1e-3, near, "same") < 0.5
        columns.append(
            np.stack([motion.position[:, 0], speed, motion.acceleration[:, 0], motion.beside[:, 0]], axis=1)[use]
        )
    q, v, a, torque = np.concatenate(columns).T
    way = signals.turning(v)
    best: signals.Fit | None = None
    offset = 0.0
    for tried in np.linspace(-0.03, 0.06, 19):  # of the pendulum's zero [rad]
        carried = MASS * 9.81 * LENGTH * np.sin(q + tried) + MASS * LENGTH**2 * a
        found = signals.fit(
            {"scale": torque, "by load": -np.abs(torque) * way, "armature": -a, "viscous": -v, "coulomb": -way}, carried
        )
        if best is None or found.explained > best.explained:
            best, offset = found, float(tried)
    assert best is not None
    return {
        "scale": best["scale"],
        "by load": best["by load"] / best["scale"],
        "armature": best["armature"],
        "viscous": best["viscous"],
        "coulomb": best["coulomb"],
        "zero": offset,
        "explained": best.explained,
    }


def regress(data: Path) -> dict[str, float]:
    """By gain, and of the pairs that give truths."""
    sets = {f"gain {gain}": places for gain, places in AT_GAIN.items()}
    sets |= {"gains 100 and 200": AT_GAIN[100] + AT_GAIN[200], "gains 400 and 800": AT_GAIN[400] + AT_GAIN[800]}
    return {f"{name}: {key}": value for name, places in sets.items() for key, value in motor(data, places).items()}


def _moves(ours: str, *, efforts: bool) -> tuple[Cause, ...]:
    rubs = Cause(("load_dependent_friction",), JOINT, BY_LOAD, "–", 0.29, 0.42, REGRESSION, ours)
    turns = Cause(
        ("armature",),
        JOINT,
        ARMATURE,
        "kg·m²",
        0.0016,
        0.0022,
        REGRESSION,
        f"{ours}; 0.0018 as Rhoban/bam published of the same runs",
    )
    flows = Cause(
        ("viscous_friction",),
        JOINT,
        VISCOUS,
        "N·m·s/rad",
        0.005,
        0.008,
        REGRESSION,
        f"{ours}; 0.0054 in Rhoban/bam's largest model, 0.0037 in its smallest",
        ("servo_damping",),
    )
    return (rubs, turns, flows) if efforts else (rubs,)


_KNOWN: Final = ({"name": "load_dependent_friction", "target": JOINT, "parameters": {"coefficient": BY_LOAD}},)
#: The zero is 5 to 25 mrad off; the scale of the torque is a data sheet's, 0.94 to 1.3 by regression.
_SMALL: Final = (
    "viscous_friction",
    "coulomb_friction",
    "encoder_bias",
    "gravity_tilt",
    "asymmetric_friction",
    "torque_constant",
)
_NOMINAL: Final = "a weighed mass at a measured length"
_LOW: Final = AT_GAIN[100] + AT_GAIN[200]
_HIGHS: Final = AT_GAIN[400] + AT_GAIN[800]

CASES: Final = (
    Case(
        "xl330-efforts-low-gains",
        "XL330",
        WHOLE,
        EFFORTS,
        SOURCE.name,
        _LOW,
        lambda data: torques(data, _LOW),
        model,
        _NOMINAL,
        "the motor's inertia and all friction",
        _moves("our regression at gains 400 and 800", efforts=True),
        truth_files=_HIGHS,
        may=_SMALL,
    ),
    Case(
        "xl330-efforts-gain-400",
        "XL330",
        WHOLE,
        EFFORTS,
        SOURCE.name,
        AT_GAIN[400],
        lambda data: torques(data, AT_GAIN[400]),
        model,
        _NOMINAL,
        "the motor's inertia and all friction",
        _moves("our regression at gains 100 and 200", efforts=True),
        truth_files=_LOW,
        may=_SMALL,
    ),
    Case(
        "xl330-commands-gain-200",
        "XL330",
        WHOLE,
        COMMANDS,
        SOURCE.name,
        AT_GAIN[200],
        lambda data: goals(data, AT_GAIN[200]),
        lambda: model(gain=200),
        f"{_NOMINAL}; servo by its register and the data sheet",
        "the motor's inertia and all friction",
        _moves("our regression at gains 400 and 800", efforts=False),
        truth_files=_HIGHS,
        may=(*_SMALL, "armature"),
        note="the servo's stiffness is a data sheet's, known to 20 %",
    ),
    Case(
        "xl330-commands-gain",
        "XL330",
        SEMI,
        COMMANDS,
        SOURCE.name,
        AT_GAIN[200],
        lambda data: goals(data, AT_GAIN[200]),
        lambda: model(gain=100, moves=True),
        f"{_NOMINAL}; servo at gain 100, inertia and friction by regression at other gains",
        "half of the servo's gain: the model has the register at 100, the servo had it at 200",
        (
            Cause(
                ("servo_stiffness",),
                JOINT,
                2.0,
                "–",
                1.6,
                2.2,
                REGISTER,
                "the register, and the logged PWM is register times error to 1e-4; the data sheet's torque per volt is "
                "known to 20 %",
                ("torque_constant",),
            ),
        ),
        truth_files=_HIGHS,
        may=_SMALL[:-1],
        known=_KNOWN,
    ),
    Case(
        "xl330-commands-nothing",
        "XL330",
        NOTHING,
        COMMANDS,
        SOURCE.name,
        AT_GAIN[200],
        lambda data: goals(data, AT_GAIN[200]),
        lambda: model(gain=200, moves=True),
        f"{_NOMINAL}; servo by its register, inertia and friction by regression at other gains",
        "nothing",
        (),
        truth_files=_HIGHS,
        may=(*_SMALL, "servo_stiffness"),
        known=_KNOWN,
        note="the servo's stiffness is known to 20 %, so a rest of it may be named",
    ),
    Case(
        "xl330-efforts-nothing",
        "XL330",
        NOTHING,
        EFFORTS,
        SOURCE.name,
        _LOW,
        lambda data: torques(data, _LOW),
        lambda: model(moves=True),
        f"{_NOMINAL}; inertia and friction by regression at other gains",
        "nothing",
        (),
        truth_files=_HIGHS,
        may=_SMALL,
        known=_KNOWN,
    ),
)
