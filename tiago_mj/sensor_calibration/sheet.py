"""Description of a load cell, estimated from recordings, in the form that environments load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml
from scipy import stats

import tiago_mj
from tiago_mj.effects import EFFECTS, Entry
from tiago_mj.gap.simulation.plant import Plant, plant_of
from tiago_mj.models import names
from tiago_mj.recordings.recording import RecordingError, Trial
from tiago_mj.registration import import_and_make
from tiago_mj.sensing.load_cell import TA11_CONTACT_UNIT
from tiago_mj.sensing.sheet import SCHEMA
from tiago_mj.sensor_calibration.rest import FALSE_CONTACTS, Rest, at_rest
from tiago_mj.sensor_calibration.scale import Scale, Simulated, scales, simulated

#: Share of the newtons that press from which it is said that the drive's force may be off by so much.
MENTIONED_SHARE: Final = 0.02
#: Stands for a robot that nobody named: rest needs none.
UNKNOWN: Final = "unknown"
HEADER: Final = """\
# Made by tiago-mj calibrate-sensor. Load it with
#   {load}
# f_raw = scale · newtons / contact_unit + bias + noise · N(0, 1), mean of the last `average`; touch: f_raw > threshold.
# Pairs are right, left. Every value under `sensors` has a 90 % interval, low to high.
"""


@dataclass(frozen=True)
class Calibration:
    """Noise, bias, threshold and scale of load cells, estimated from recordings.

    Attributes:
        rests: of every cell.
        scales: of the cells that were pressed in a grasp that could be simulated; may be empty.
        false_contacts: probability of a reading above the threshold without contact.
        contact_unit: unit of contact force that the scale is per [N].
        average: readings are the mean of so many samples.
        robot: whose simulator gave the forces; "" where none did.
        recordings: names.
        notes: what could not be had, a sentence each.
    """

    rests: tuple[Rest, ...]
    scales: tuple[Scale, ...]
    false_contacts: float
    contact_unit: float
    average: int
    robot: str
    recordings: tuple[str, ...]
    notes: tuple[str, ...]

    def load(self, path: str) -> str:
        """Python that makes an environment with these load cells: the one that was simulated, else the gripper's."""
        return import_and_make(self.robot or "GripperTactile-v0", sensing=path)


def calibrate(
    trials: Sequence[Trial],
    *,
    env: str | None = None,
    given: Sequence[Entry] = (),
    false_contacts: float = FALSE_CONTACTS,
    threads: int = 0,
) -> Calibration:
    """Noise, bias and threshold of every load cell, and its scale where grasps can be simulated.

    Args:
        trials: of one robot.
        env: environment to simulate, where the recordings do not say.
        given: effects that are known already: the simulated grasps have them. Those of the load cells are left out,
            they are what is measured here.
        false_contacts: probability of a reading above the threshold without contact, above 0 and below 0.5.
        threads: of the simulations.

    Raises:
        RecordingError: no load cell, no rest, a cell without noise; one line.
        ValueError: the probability is none, or a given effect has a target that the robot does not have.
    """
    if not 0 < false_contacts < 0.5:
        raise ValueError(f"a probability of false contacts of {false_contacts:g}: give one above 0 and below 0.5")
    notes: list[str] = []
    cells = [entry.name for entry in given if EFFECTS[entry.name].stage == "force_sensor"]
    if cells:
        notes.append(f"{', '.join(cells)} of --effects: left out, as the load cells are what is measured here.")
    given = [entry for entry in given if entry.name not in cells]
    pressed = [trial for trial in trials if trial.commands]
    if len(pressed) < len(trials):
        notes.append(
            f"{len(trials) - len(pressed)} of {len(trials)} recordings hold no commands: they tell the noise only."
        )
    grasps = _simulated(pressed, env, given, threads)
    notes += grasps.notes
    touched = None
    if grasps.known is not None:
        by_name = {trial.name: rows for trial, rows in zip(pressed, grasps.known.touched, strict=True)}
        touched = [by_name.get(trial.name, trial.time < 0) for trial in trials]
    rests = at_rest(trials, touched)
    found: tuple[Scale, ...] = ()
    if grasps.plant is not None and grasps.known is not None:
        found = scales(grasps.plant, pressed, grasps.known, rests)
        notes += _about_drives(found)
    notes += _about_rests(rests)
    notes += _about_scales(found, rests if grasps.known is not None else ())
    sensing = trials[0].sidecar.sensing or {}
    return Calibration(
        rests=rests,
        scales=tuple(scale for scale in found if scale.known),
        false_contacts=false_contacts,
        contact_unit=float(sensing.get("contact_unit") or TA11_CONTACT_UNIT),
        average=int(sensing.get("average") or 1),
        robot=grasps.robot,
        recordings=tuple(trial.name for trial in trials),
        notes=tuple(notes),
    )


@dataclass(frozen=True)
class _Grasps:
    """The recorded grasps, simulated.

    Attributes:
        robot: name of the simulator; "" where none was found.
        plant, known: the simulator and the forces; None where nothing could be simulated.
        notes: why not, a sentence each.
    """

    robot: str = ""
    plant: Plant | None = None
    known: Simulated | None = None
    notes: tuple[str, ...] = ()


def _simulated(pressed: Sequence[Trial], env: str | None, given: Sequence[Entry], threads: int) -> _Grasps:
    """Forces on the pads in the recorded grasps, from a simulation of their commands."""
    if not pressed:
        return _Grasps()
    if not env and pressed[0].sidecar.robot in ("", UNKNOWN):
        return _Grasps(notes=("Nothing says which robot this is, so there is no scale: give --env ID.",))
    robot = ""
    try:
        plant = plant_of(pressed, env=env, given=given)
        robot = plant.name
        if plant.pads is not None:
            return _Grasps(robot, plant, simulated(plant, pressed, threads=threads))
    except RecordingError as fault:
        return _Grasps(robot, notes=(f"No grasp could be simulated, so there is no scale: {fault}",))
    return _Grasps(robot, notes=(f"{robot} has no load cells in simulation: no scale.",))


def _about_rests(rests: Sequence[Rest]) -> list[str]:
    """Load cells whose noise is not normal or whose level changed while nothing touched them: a sentence each."""
    out = []
    for rest in rests:
        if rest.heavy_tailed:
            out.append(
                f"force.{rest.sensor}: {rest.above} of {rest.readings} readings at rest lie 3 deviations above the "
                f"bias, {rest.readings * stats.norm.sf(3):.1f} are expected of normal noise: raise the threshold."
            )
        if rest.stray:
            out.append(f"force.{rest.sensor}: {rest.stray} stretches of rest were left out, their level is another.")
    return out


def _about_scales(found: Sequence[Scale], rests: Sequence[Rest]) -> list[str]:
    """Load cells that no simulated grasp presses, and grasps that differ from their simulation: a sentence each."""
    having = {scale.sensor for scale in found}
    out = [f"force.{r.sensor}: no grasp as simulated presses it: no scale." for r in rests if r.sensor not in having]
    return out + [
        f"force.{s.sensor}: {s.unlike} grasps are not as simulated and were left out: is the object as in the sidecar?"
        for s in found
        if s.unlike and s.known
    ]


def _about_drives(found: Sequence[Scale]) -> list[str]:
    """Sentences on scales that are unknown or uncertain because of the drive, for all cells concerned together."""
    mend = "record the robot moving without contact, diagnose that, and give what it finds (--effects calibration.yaml)"
    lost = [s for s in found if not s.known]
    wide = [s for s in found if s.known and s.lost[0] > MENTIONED_SHARE * s.lost[1]]
    turned = [s for s in found if s.known and s not in wide and abs(s.turned) > MENTIONED_SHARE]
    out = []
    for some, so in ((lost, "no scale"), (wide, "a wide interval")):
        if some:
            force, of = (", ".join(f"{s.lost[k]:.2g}" for s in some) for k in (0, 1))
            out.append(
                f"{_cells(some)}: {so}: the drive needs {force} N else than simulated to move a finger freely, as with "
                f"friction, where {of} N press the pad: {mend}."
            )
    if turned:
        apart = ", ".join(f"{s.turned:+.1%}" for s in turned)
        out.append(
            f"{_cells(turned)}: a wide interval: {apart} per newton where the force has fallen against where it has "
            f"risen, as with friction of the drive or hysteresis of the cell: {mend}."
        )
    return out


def _cells(some: Sequence[Scale]) -> str:
    return ", ".join(f"force.{scale.sensor}" for scale in some)


def text(calibration: Calibration, name: str = "sensor.yaml") -> str:
    """The file's text.

    Args:
        calibration: the answer.
        name: of the file.
    """
    per_sample = calibration.average**0.5  # a mean of k samples scatters √k times less than a sample
    rests = {rest.sensor: rest for rest in calibration.rests}
    sizes = {scale.sensor: scale for scale in calibration.scales}
    order: list[str] = [side for side in names.SIDES if side in rests] or list(rests)
    cell: dict[str, Any] = {
        "contact_unit": calibration.contact_unit,
        "average": calibration.average,
        "noise": _both([rests[s].noise * per_sample for s in order]),
        "bias": _both([rests[s].bias for s in order]),
        "threshold": _both([rests[s].threshold(calibration.false_contacts)[0] for s in order]),
    }
    if sizes:
        each = {s: sizes[s].per_newton for s in order if s in sizes}
        mean = sum(each.values()) / len(each)
        cell["scale"] = _both([each.get(s, mean) * calibration.contact_unit for s in order])
    data = {
        "schema": SCHEMA,
        **cell,
        "sensors": {sensor: _sensor(rest, sizes.get(sensor), calibration) for sensor, rest in rests.items()},
        "rule": {
            "threshold": "bias + z · (standard deviation of a reading)",
            "false_contacts": calibration.false_contacts,
            "z": round(float(stats.norm.isf(calibration.false_contacts)), 6),
        },
        "notes": list(calibration.notes),
        "source": {
            "recordings": list(calibration.recordings),
            "robot": calibration.robot,
            "tool": f"tiago-mj calibrate-sensor {tiago_mj.__version__}",
        },
    }
    dumped: str = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=120)
    return HEADER.format(load=calibration.load(Path(name).name)) + dumped


def _sensor(rest: Rest, scale: Scale | None, calibration: Calibration) -> dict[str, Any]:
    threshold, interval = rest.threshold(calibration.false_contacts)
    per_sample = calibration.average**0.5
    out: dict[str, Any] = {
        "noise": _value(rest.noise * per_sample, [v * per_sample for v in rest.noise_interval], "sensor units"),
        "bias": _value(rest.bias, rest.bias_interval, "sensor units"),
        "threshold": _value(threshold, interval, "sensor units"),
    }
    if scale is not None:
        unit = calibration.contact_unit
        out["scale"] = _value(
            scale.per_newton * unit, [v * unit for v in scale.interval], "sensor units / contact_unit"
        )
        out["grasps"], out["misfit"] = scale.grasps, _digits(scale.misfit)
    out["rest"] = {"readings": rest.readings, "independent": round(rest.independent, 1), "windows": rest.windows}
    return out


def _both(values: Sequence[float]) -> float | list[float]:
    """One number, or a pair (right, left)."""
    return _digits(values[0]) if len(values) == 1 else [_digits(v) for v in values]


def _value(value: float, interval: Sequence[float], unit: str) -> dict[str, Any]:
    return {"value": _digits(value), "low": _digits(interval[0]), "high": _digits(interval[1]), "unit": unit}


def _digits(value: float) -> float:
    return float(f"{value:.6g}")
