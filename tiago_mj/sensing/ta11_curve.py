"""The real TA11 force curve, and its own measurement replayed in simulation.

On a real TIAGo gripper with TA11 load cells, four objects were squeezed with a constant position error: every 40 ms the
position command of each finger was its *measured* position minus dq, and the fingertip force after 6 s was noted. The
68 numbers in :data:`MEASURED` are those facts (llach/learning_fc, series A: commit ee792cf, series B: 3dd34c2).

What the protocol does: for every object the servo error is held at dq, so a proportional servo of stiffness k presses
with the force k · dq, and the curve's slope is (servo stiffness) × (sensor gain). The curve tells this product alone:
neither of the two, and nothing of the object. As the command follows the measured position, nothing holds the fingers
in place: they close until the object pushes back with k · dq, and where object and fingers stand along the grasp axis
is left to chance and friction. :attr:`Replay.drift` says how fast the fingers still move when the force is read.

The replay goes through the public environment: position control at 25 Hz, the load cell's noise, and the mean of the
last 10 readings, as on the robot. One thing differs: the environment moves the set point to a new command evenly within
the 40 ms, no faster than the finger's speed limit, where the robot's jumps. The fingers therefore approach more slowly;
the steady force is the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Final

import gymnasium
import numpy as np
from numpy.typing import NDArray

from tiago_mj.models import names
from tiago_mj.models.objects import OBJECTS, GraspObject

Array = NDArray[np.float64]

SOURCE: Final = "llach/learning_fc, commits ee792cf (series A) and 3dd34c2 (series B)"

#: The robot's command rate [Hz], length of a trial [s] and readings that make the steady force (its robot scripts).
CONTROL_HZ: Final = 25.0
TRIAL_SECONDS: Final = 6.0
STEADY_READINGS: Final = 10
#: A command is sent only where it differs from the measured position by more than this [m]; so are fits made.
SENT_ABOVE: Final = 0.3e-3


@dataclass(frozen=True)
class Series:
    """Steady force over held servo error, of one object in one session.

    Attributes:
        session: ``A`` or ``B``.
        object: what was squeezed.
        dq: held servo error of each finger, (n,) [m].
        force: steady reading, (n,) [sensor units].
    """

    session: str
    object: str
    dq: tuple[float, ...]
    force: tuple[float, ...]


_DQ_A: Final = (0.4e-3, 0.5e-3, 0.6e-3, 0.7e-3, 0.8e-3, 0.9e-3, 1.0e-3, 1.2e-3, 1.5e-3, 2.0e-3, 2.5e-3, 3.0e-3)
_DQ_B: Final = (0.3e-3, 0.6e-3, 0.9e-3, 1.2e-3, 1.5e-3, 1.8e-3, 2.1e-3, 2.4e-3, 2.7e-3, 3.0e-3)

MEASURED: Final = (
    Series("A", "wood", _DQ_A, (0.04, 0.075, 0.11, 0.13, 0.15, 0.19, 0.23, 0.31, 0.43, 0.58, 0.72, 0.90)),
    Series("A", "pringles", _DQ_A, (0.06, 0.10, 0.13, 0.16, 0.19, 0.22, 0.28, 0.34, 0.43, 0.51, 0.65, 0.79)),
    Series("A", "glue", _DQ_A, (0.037, 0.07, 0.10, 0.12, 0.15, 0.18, 0.21, 0.28, 0.37, 0.47, 0.66, 0.71)),
    Series("A", "sponge", _DQ_A, (0.01, 0.06, 0.09, 0.10, 0.11, 0.16, 0.19, 0.26, 0.35, 0.50, 0.57, 0.65)),
    Series("B", "wood", _DQ_B, (0.0, 0.13, 0.24, 0.36, 0.47, 0.54, 0.62, 0.75, 0.83, 0.94)),
    Series("B", "sponge", _DQ_B, (0.0, 0.10, 0.15, 0.32, 0.37, 0.47, 0.54, 0.60, 0.63, 0.81)),
)

#: Stand-ins for the measured objects, at their measured widths (llach/learning_fc 3dd34c2). Stiffness and mass are not
#: known and do not show in the curve. No width is known for the glue bottle: it is compared with, not simulated.
ITEMS: Final = MappingProxyType(
    {
        "wood": OBJECTS["wood"],
        "pringles": GraspObject(width=0.074),
        "sponge": OBJECTS["sponge"],
    }
)


@dataclass(frozen=True)
class Line:
    """Least-squares line force = slope · (dq − dead_band).

    Attributes:
        slope: [sensor units per metre].
        dead_band: where the line meets zero force [m].
        rms: root mean square of what the line leaves [sensor units].
    """

    slope: float
    dead_band: float
    rms: float


@dataclass(frozen=True)
class Replay:
    """The measurement, simulated.

    Attributes:
        object: key of :data:`ITEMS`.
        dq: held servo error, (n,) [m].
        force: steady readings, (n, 2), right and left [sensor units].
        drift: finger speed over the readings that make the steady force, (n, 2) [m/s]; negative closes.
    """

    object: str
    dq: Array
    force: Array
    drift: Array

    @property
    def line(self) -> Line:
        """Straight line fitted to the mean force of both fingers."""
        return fit_line(self.dq, self.force.mean(axis=1))


@dataclass(frozen=True)
class Comparison:
    """Simulated and measured force curves.

    Attributes:
        measured: a line per entry of :data:`MEASURED`, in its order.
        replays: one per entry of :data:`ITEMS`.
    """

    measured: tuple[Line, ...]
    replays: tuple[Replay, ...]

    @property
    def slopes(self) -> tuple[float, float]:
        """Least and greatest measured slope [sensor units per metre]."""
        slopes = [line.slope for line in self.measured]
        return min(slopes), max(slopes)

    @property
    def dead_bands(self) -> tuple[float, float]:
        """Least and greatest measured dead band [m]."""
        bands = [line.dead_band for line in self.measured]
        return min(bands), max(bands)

    @property
    def slopes_agree(self) -> bool:
        """Whether every simulated slope lies within the spread of the measured ones."""
        low, high = self.slopes
        return all(low <= replay.line.slope <= high for replay in self.replays)

    @property
    def unexplained_force(self) -> float:
        """Largest measured dead band times its slope: the steady force by which the simulation is too large [sensor
        units]."""
        simulated = float(np.mean([replay.line.dead_band for replay in self.replays]))
        return max(line.slope * (line.dead_band - simulated) for line in self.measured)


def fit_line(dq: Sequence[float] | Array, force: Sequence[float] | Array) -> Line:
    """The line through the points with dq above :data:`SENT_ABOVE`; below it no command was sent.

    Raises:
        ValueError: fewer than two such points.
    """
    x, y = np.asarray(dq, dtype=np.float64), np.asarray(force, dtype=np.float64)
    used = is_sent(x)
    if np.unique(x[used]).size < 2:
        raise ValueError(f"a line needs two values of dq above {SENT_ABOVE * 1e3:g} mm: there are {x[used]} m")
    slope, offset = np.polyfit(x[used], y[used], 1)
    rest = y[used] - (slope * x[used] + offset)
    return Line(float(slope), float(-offset / slope), float(np.sqrt(np.mean(rest**2))))


def is_sent(change: Array) -> NDArray[np.bool_]:
    """Whether a command that differs by ``change`` [m] from the measured position is sent; exactly 0.3 mm is not."""
    return np.abs(change) > SENT_ABOVE + 1e-9


def make_bench(
    item: GraspObject,
    *,
    control: str = "position",
    control_hz: float = CONTROL_HZ,
    object_offset: float = 0.0,
    **arguments: Any,
) -> gymnasium.Env[Any, Any]:
    """The environment in which the measurement is replayed: GripperTactile commanded as the robot was.

    Args:
        item: what stands between the fingers, in their middle.
        control, control_hz, object_offset: of the environment, as the robot was commanded.
        **arguments: further ones of the environment: another servo or sensor.
    """
    return gymnasium.make(
        "tiago_mj/GripperTactileGoal-v0",
        object=item,
        control=control,
        control_hz=control_hz,
        object_offset=object_offset,
        **arguments,
    )


def squeeze(env: gymnasium.Env[Any, Any], dq: float, *, seed: int = 0) -> tuple[Array, Array]:
    """One trial of the protocol.

    Args:
        env: from :func:`make_bench`.
        dq: servo error to hold [m].
        seed: of the sensor noise.

    Returns:
        Steady reading (2,) [sensor units] and residual finger speed (2,) [m/s], right and left.
    """
    core: Any = env.unwrapped
    low, high = (core.model.joint(names.FINGERS[0]).range[i] for i in range(2))
    env.reset(seed=seed)
    command = core.state.position.copy()
    positions, readings = [], []
    for _ in range(round(TRIAL_SECONDS * CONTROL_HZ)):
        measured = core.state.position
        wanted = np.clip(measured - dq, low, high)
        command = np.where(is_sent(wanted - measured), wanted, command)
        env.step(2 * (command - low) / (high - low) - 1)
        positions.append(core.state.position)
        readings.append(core.state.force_raw)
    steady = np.mean(readings[-STEADY_READINGS:], axis=0)
    speed = (positions[-1] - positions[-STEADY_READINGS]) * CONTROL_HZ / (STEADY_READINGS - 1)
    return steady, speed


def replay_object(name: str, dq: Sequence[float] | None = None, *, seed: int = 0, **arguments: Any) -> Replay:
    """Replay the measurement of one object.

    Args:
        name: key of :data:`ITEMS`.
        dq: servo errors to hold [m]; None: those at which that object was measured.
        seed: of the sensor noise; trial i uses seed + i.
        **arguments: see :func:`make_bench`; ``object_…`` arguments change the stand-in.

    Raises:
        ValueError: an object that was not measured, or whose width is not known.
    """
    if name not in ITEMS:
        raise ValueError(f"object {name!r} has no stand-in: use one of {', '.join(ITEMS)}")
    held = sorted({x for series in MEASURED if series.object == name for x in series.dq}) if dq is None else list(dq)
    env = make_bench(replace(ITEMS[name]), **arguments)
    try:
        trials = [squeeze(env, value, seed=seed + i) for i, value in enumerate(held)]
    finally:
        env.close()
    return Replay(name, np.array(held), np.array([f for f, _ in trials]), np.array([v for _, v in trials]))


def compare(*, seed: int = 0, **arguments: Any) -> Comparison:
    """Fit the six measured series and replay them; arguments as of :func:`replay_object`. Takes some seconds."""
    return Comparison(
        measured=tuple(fit_line(series.dq, series.force) for series in MEASURED),
        replays=tuple(replay_object(name, seed=seed, **arguments) for name in ITEMS),
    )
