"""Import of pendulum recordings: a Dynamixel XL330-M288-T swings a known mass at a known length.

The servo's position loop is proportional (the logged PWM is its gain times the position error, to 1e-4), so what drives
the pendulum is known: the PWM, the supply voltage and the speed, by the motor's constants. It is written as command
[N·m] (``interface: effort``), which holds at every gain and while the torque is switched off; or, with
``commands="position"``, the goal position is, one folder a gain, without what follows a switch-off.

``pendulum.xml`` beside the recordings is the pendulum: its mass, its length, nothing of friction or of the motor.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import Field

from tiago_mj.effects.actuator import TorqueConstant
from tiago_mj.io.loading import load_json
from tiago_mj.io.quoting import one_line, quoted
from tiago_mj.io.schema import Open, checked
from tiago_mj.models import inverse
from tiago_mj.recordings.imports.public import DataSet, folder_of
from tiago_mj.recordings.read.clock import MIN_ROWS
from tiago_mj.recordings.recording import SCHEMA, Array, RecordingError, Sidecar, Trial

DATA: Final = DataSet(
    name="xl330",
    repository="Rhoban/bam",
    commit="af2260462471ff45ac18af159b1327ea51d8db15",
    path="bam/data.bak/raw",
    licence="Apache-2.0",
    sha256={
        "2026-01-15_10h28m10.json": "e58f3c2a08a5e0e37a2c5e930d0830a438bc102b8d21482767124f495b92f2ce",
        "2026-01-15_10h28m17.json": "ef6507934ba465eb31529d7d98715ecc70bd5c87be049fd4618a94ce39290569",
        "2026-01-15_10h28m24.json": "165b171df12b3e8b39504ce36d37e373ad105c0dddf4d3d073c747fd492e8bef",
        "2026-01-15_10h28m32.json": "fdc255edae6995298af437f37582eb8cd0c4a5ddcec4f49fb7c4d6f3303aaa9c",
        "2026-01-15_10h28m42.json": "1c6386bfa3be021c8ca8a96a7cbee93914f6271a050282b1c3b7d5ef373427db",
        "2026-01-15_10h28m49.json": "e2223826274fca7799a2be0cb371e4269ead88cd9077fbb68498ef93e4e0de97",
        "2026-01-15_10h28m57.json": "c10a350d9c7222d4d3499d140edd3ac4e63fe94f3b59a675116a34db7d66152c",
        "2026-01-15_10h29m04.json": "7996c43314a9f60094a6119346b54ff9ff84cb6726c967f4a88a7175278f6515",
    },
)
JOINT: Final = "pendulum"
COMMANDS: Final = ("torque", "position")
MODEL: Final = "pendulum.xml"

#: The motor's name in the files. Others of the same repository hang on the same pendulum.
MOTOR: Final = "xl330"

#: Torque [N·m] and current [A] at stall, at 5.0 V (ROBOTIS e-Manual, XL330-M288-T). Their ratio is the torque constant,
#: which is the constant of the back electromotive force, too [V·s/rad]. The speed without load of the same sheet would
#: give 0.46 V·s/rad, but the friction that is to be found has slowed that down.
STALL_TORQUE, STALL_CURRENT, AT_VOLTS = 0.52, 1.47, 5.0
BACK_EMF: Final = STALL_TORQUE / STALL_CURRENT
#: The sheet's stall torques at 3.7 and 6.0 V, 0.42 and 0.60 N·m, are up to 9 % off a line through zero and rise with
#: 0.078 instead of 0.104 N·m/V, and are what the gears' friction leaves: the scale of the torque is known to 30 %. The
#: sidecars say so; the known weight of the pendulum tells it better.
TORQUE_KNOWN_TO: Final = 0.3
#: Of the positions, for their derivative [Hz]: the fastest trajectory ends at 2 Hz.
SPEED_CUTOFF: Final = 20.0
#: PWM of full voltage (same, PWM Limit 885, unit 0.113 %).
FULL_PWM: Final = 885.0
#: PWM per position error [1/rad] and per unit of the servo's gain: 4096 steps a turn, gain in 1/256 (a test compares
#: with the logged PWM).
PWM_PER_RADIAN: Final = 4096 / (2 * np.pi) / 256
_ENTRY: Final = ("position", "speed", "load", "input_volts", "timestamp", "goal_position", "torque_enable")


@dataclass(frozen=True)
class Run:
    """A recording with the columns of its file.

    Attributes:
        file: its name.
        facts: everything but the samples: ``mass`` [kg], ``length`` [m], ``kp``, ``vin`` [V], ``trajectory``.
        columns: samples by name, (n,).
    """

    file: str
    facts: dict[str, Any]
    columns: dict[str, Array]

    @property
    def pwm(self) -> Array:
        """PWM with its sign, stored as the upper half of 16 bits."""
        load = self.columns["load"]
        return np.where(load >= 1 << 15, load - (1 << 16), load)

    @property
    def speed(self) -> Array:
        """From the positions [rad/s]: the servo's own speed trails them by 20 to 30 ms, and a back electromotive force
        that late would look like inertia."""
        time = self.columns["timestamp"]
        rate = float(1 / np.median(np.diff(time)))
        grid, position = inverse.uniform(time, self.columns["position"][:, None], rate)
        smooth = inverse.low_pass(position, rate=rate, cutoff=min(SPEED_CUTOFF, 0.2 * rate))[:, 0]
        return np.interp(time, grid, np.gradient(smooth, 1 / rate))

    @property
    def torque(self) -> Array:
        """Of the motor [N·m], by its voltage less what its speed induces; 0 while the torque is switched off."""
        volts = self.pwm / FULL_PWM * self.columns["input_volts"]
        line = STALL_TORQUE / AT_VOLTS * (volts - BACK_EMF * self.speed)
        return np.where(self.columns["torque_enable"] > 0, line, 0.0)


def trials(source: str, commands: str = "torque") -> Iterator[tuple[str, Trial]]:
    """Trials, and the folder below the output that each belongs to ("" for the output itself).

    Args:
        source: folder of the JSON files, or ``download``.
        commands: ``torque`` or ``position``.

    Raises:
        RecordingError: no recording is there, or a file is not what it was.
    """
    if commands not in COMMANDS:
        raise ValueError(f"commands {quoted(commands)} are unknown: use one of {', '.join(COMMANDS)}")
    folder = folder_of(DATA, source)
    files = sorted(path for path in folder.glob("*.json"))
    if not files:
        raise RecordingError(f"{folder}: no JSON file is there: give the folder of the recordings, or 'download'")
    for path in files:
        run = read_run(path)
        yield (f"kp{run.facts['kp']:g}" if commands == "position" else ""), _trial(run, commands)


def pendulum(mass: float, length: float, *, stiffness: float | None = None, damping: float = 0.0) -> str:
    """MJCF of a point mass on a hinge, hanging down at 0; driven by a torque, or by a position servo.

    Args:
        mass: [kg].
        length: from the hinge [m].
        stiffness: of the position servo [N·m/rad]; None: the command is a torque.
        damping: of the position servo, its motor's back electromotive force [N·m·s/rad].
    """
    servo = (
        f'<motor name="{JOINT}" joint="{JOINT}"/>'
        if stiffness is None
        else f'<position name="{JOINT}" joint="{JOINT}" kp="{stiffness:.6g}" kv="{damping:.6g}"/>'
    )
    # The rod weighs nothing. MuJoCo needs some inertia about the mass itself: a sphere of 10 mm adds 0.4 % to m l².
    return f"""<mujoco model="pendulum">
  <compiler angle="radian"/>
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>
    <body name="arm">
      <joint name="{JOINT}" axis="0 -1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 {-length:.6g}" size="0.004" mass="0" contype="0" conaffinity="0"/>
      <geom type="sphere" pos="0 0 {-length:.6g}" size="0.01" mass="{mass:.6g}" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator>{servo}</actuator>
</mujoco>
"""


def model_for(trial: Trial) -> str:
    """The MJCF that belongs beside a trial."""
    servo = trial.sidecar.servo or {}
    if trial.sidecar.interface == "effort":
        return pendulum(servo["mass_kg"], servo["length_m"])
    return pendulum(
        servo["mass_kg"], servo["length_m"], stiffness=servo["stiffness"][JOINT], damping=servo["damping"][JOINT]
    )


class _Facts(Open):
    mass: float = Field(gt=0)
    length: float = Field(gt=0)
    kp: float
    vin: float
    trajectory: str | int
    entries: list[dict[str, Any]]


def read_run(path: Path) -> Run:
    """A recording from its file.

    Raises:
        RecordingError: it is cut off, of another format or of another motor.
    """
    try:
        facts = load_json(path, "it is no JSON")
        checked(_Facts, facts)
        entries = facts.pop("entries")
        columns = {name: np.array([float(entry[name]) for entry in entries]) for name in _ENTRY}
        facts["trajectory"] = str(facts["trajectory"])
        if not all(np.isfinite(column).all() for column in columns.values()):
            raise ValueError("an entry is not finite")
    except (KeyError, TypeError, ValueError) as fault:
        raise RecordingError(f"{path.name}: not the data set's format, or cut off ({one_line(fault)})") from fault
    motor = facts.get("motor")
    if motor != MOTOR:
        said = "it does not say which motor it is of" if motor is None else f"it is of the motor {quoted(motor)}"
        raise RecordingError(
            f"{path.name}: {said}, and the torque is made with the constants of the {MOTOR!r} alone: leave the file "
            "out, or write its torques as a recording of your own (docs/recordings.md)"
        )
    if not entries:
        raise RecordingError(f"{path.name}: the recording is empty: leave it out")
    if len(entries) < MIN_ROWS or (np.diff(columns["timestamp"]) <= 0).any():
        raise RecordingError(
            f"{path.name}: it has {len(entries)} samples, or its stamps do not increase; {MIN_ROWS} and more are "
            "needed: leave it out"
        )
    return Run(path.name, facts, columns)


def _trial(run: Run, commands: str) -> Trial:
    columns, facts = run.columns, run.facts
    on = columns["torque_enable"] > 0
    rows = slice(None)
    if commands == "position" and not on.all():
        rows = slice(0, int(np.argmin(on)))  # what the servo is told while it is off is no command
    time = columns["timestamp"][rows]
    name = f"{facts['trajectory']}-kp{facts['kp']:g}"
    position, speed = columns["position"][rows], columns["speed"][rows]
    torque = run.torque[rows]
    off = columns["timestamp"][~on] - columns["timestamp"][0]
    per_volt = STALL_TORQUE / AT_VOLTS
    servo = {
        "name": "Dynamixel XL330-M288-T",
        "kp": facts["kp"],
        "vin": facts["vin"],
        "stiffness": {JOINT: facts["kp"] * PWM_PER_RADIAN / FULL_PWM * facts["vin"] * per_volt},
        "damping": {JOINT: per_volt * BACK_EMF},
        "mass_kg": facts["mass"],
        "length_m": facts["length"],
        "torque_off_s": [float(off[0]), float(off[-1])] if len(off) else None,
    }
    sent = torque if commands == "torque" else columns["goal_position"][rows]
    extras = {
        "pwm": run.pwm[rows],
        "volts": columns["input_volts"][rows],
        "torque_enable": columns["torque_enable"][rows],
    }
    return Trial(
        name=name,
        time=time - time[0],
        commands={JOINT: sent},
        positions={JOINT: position},
        velocities={JOINT: speed},
        efforts={JOINT: torque},
        forces={},
        extras={**extras, "goal_position": columns["goal_position"][rows]},
        sidecar=Sidecar(
            schema=SCHEMA,
            trial=name,
            robot=MODEL,
            rate_hz=round(float(1 / np.median(np.diff(time))), 4),
            interface="effort" if commands == "torque" else "position",
            servo=servo,
            initial={"position": {JOINT: float(position[0])}, "velocity": {JOINT: float(speed[0])}},
            motion=facts["trajectory"],
            source={
                **DATA.source,
                "file": run.file,
                "imported": f"effort [N·m] from PWM, voltage and speed: {per_volt:.3g} N·m/V, {BACK_EMF:.3g} V·s/rad, "
                f"from {STALL_TORQUE} N·m and {STALL_CURRENT} A at {AT_VOLTS} V, the speed from the positions; 0 while "
                "the torque is off; "
                f"first stamp {time[0]:.6g} s set to 0",
                "unknown": "scale of the torque, to 30 %: it is the data sheet's",
            },
            raw={"uncertainty": {TorqueConstant.name: TORQUE_KNOWN_TO}},
        ),
        source=f"{name}.parquet",
    )
