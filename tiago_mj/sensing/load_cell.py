"""A load cell: contact force in newtons becomes a raw reading, and a touched-or-not reading.

    f_raw    = scale · f_contact + noise,   f_contact = newtons / contact_unit,   noise ~ N(0, 0.0077)
    f_binary = 1 if f_raw > threshold else 0

as the paper prints them (section III-B, "Tactile Data Modeling"). Two facts decide the range of ``f_raw``:

* The paper multiplies by 100 because that made the simulated range like the real sensor's; its unit of force was
  whatever PyBullet's contacts gave in that scene. Its released code *divides* newtons by 100.
* The real TA11, on the real gripper, gives about 330 sensor units per metre by which the finger's position servo is
held
  off its target on wood, and about 300 on softer things (``shared`` curve: llach/learning_fc ee792cf and 3dd34c2).

Here ``contact_unit`` [N] stands in for Bullet's unit of force and is set so that the range is the real one. The servo
has 2000 N/m, so 330 sensor units per metre are 330 / 2000 sensor units per newton, and 100 / contact_unit is the same:

    contact_unit = 100 · 2000 / 330 = 606 N,  f_raw = newtons / 6.06

The paper's goal of 1.0 is then 6.06 N per finger, and the fingers' 16 N limit is 2.64. Two other readings of the same
sentence are presets, each with the same physical goal: ``released`` (newtons / 100: goal 0.0606) and ``newtons``
(contact_unit 1 N, so f_raw is 100 per newton: goal 606).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.io.quoting import is_number, quoted

Array = NDArray[np.float64]

#: Standard deviation of the real TA11 without contact, from 10 000 samples [sensor units] (paper, section III-B).
TA11_NOISE: Final = 0.0077
#: Stiffness of the real fingers' position servo [N/m] (pal-robotics/pal_gripper b633656, pids.yaml).
SERVO_STIFFNESS: Final = 2000.0
#: Sensor units per metre of servo error on wood (force_vs_displacement, series wood A: 332.7, B: 330).
TA11_SLOPE: Final = 330.0
#: The paper's factor.
PAPER_SCALE: Final = 100.0
#: Newtons that stand in for Bullet's unit of force, see the module's text.
TA11_CONTACT_UNIT: Final = PAPER_SCALE * SERVO_STIFFNESS / TA11_SLOPE
#: The paper's goal, 1.0 sensor units, in newtons per finger.
GOAL_NEWTONS: Final = SERVO_STIFFNESS / TA11_SLOPE


def _numbers(given: Any) -> bool:
    """Whether a value is one finite number, or two."""
    return is_number(given) or (isinstance(given, (list, tuple)) and len(given) == 2 and all(map(is_number, given)))


@dataclass(frozen=True)
class LoadCell:
    """Conversion of the force on a pad [N] to load-cell readings. Of two numbers the first is the right finger's; a
    single one serves both.

    Attributes:
        scale: sensor units per unit of contact force; one number or two.
        contact_unit: the unit of contact force [N].
        noise: standard deviation of one sample [sensor units]; one number or two.
        threshold: above it a reading counts as touch, (right, left) [sensor units]; one number serves both. By default
            5 standard deviations: at 3, a single sample in 740 is a false contact, several per episode at 240 Hz with
            two fingers, which is what spread the original's results when it was measured.
        average: a reading is the mean of this many last samples; 1 is none. The 2021 code had 4 (until c8f64ca).
        bias: reading without contact [sensor units]; one number or two. 0, as in the paper, is a cell that was tared.
    """

    scale: float | tuple[float, float] = PAPER_SCALE
    contact_unit: float = TA11_CONTACT_UNIT
    noise: float | tuple[float, float] = TA11_NOISE
    threshold: float | tuple[float, float] | None = None
    average: int = 1
    bias: float | tuple[float, float] = 0.0

    def __post_init__(self) -> None:
        for name in ("scale", "noise", "bias", "threshold"):
            given = getattr(self, name)
            given = given.tolist() if isinstance(given, np.ndarray) else given
            if not _numbers(given) and not (name == "threshold" and given is None):
                raise ValueError(f"load cell {name} is {quoted(given)}: give one number, or two (right, left)")
            if isinstance(given, list):
                given = tuple(map(float, given))  # hashable, as the others
            object.__setattr__(self, name, given)
        if not (np.asarray(self.scale) > 0).all():
            raise ValueError(f"load cell scale is {quoted(self.scale)}: give a positive, finite number")
        if not (is_number(self.contact_unit) and self.contact_unit > 0):
            raise ValueError(f"load cell contact_unit is {quoted(self.contact_unit)}: give a positive, finite number")
        if not (np.asarray(self.noise) >= 0).all():
            raise ValueError(
                f"load cell noise is {quoted(self.noise)}: give a standard deviation of 0 or more [sensor units]"
            )
        whole = isinstance(self.average, (int, np.integer)) and not isinstance(self.average, bool)
        if not (whole and 1 <= self.average <= 1000):
            raise ValueError(
                f"load cell average is {quoted(self.average)}: give a whole number of samples from 1 to 1000"
            )

    @cached_property
    def thresholds(self) -> Array:
        """(2,) [sensor units], right and left; read-only."""
        limit = np.asarray(self.bias) + 5 * np.asarray(self.noise) if self.threshold is None else self.threshold
        return np.broadcast_to(np.asarray(limit, dtype=float), (2,))

    @cached_property
    def noises(self) -> Array:
        """Standard deviation of one sample, (2,) [sensor units], right and left; read-only."""
        return np.broadcast_to(np.asarray(self.noise, dtype=float), (2,))

    @cached_property
    def _arrays(self) -> tuple[Array, Array, Array, Array | None]:
        """Contact unit, scale, noise and bias (None: 0) as arrays, converted once."""
        unit, scale, noise, bias = (np.array(n, float) for n in (self.contact_unit, self.scale, self.noise, self.bias))
        return unit, scale, noise, None if self.bias == 0 else bias

    def units(self, newtons: float) -> float:
        """Reading [sensor units] at a force [N], without bias and noise; the mean of two cells."""
        if isinstance(self.scale, tuple):
            return float(np.mean(self.scale)) * newtons / self.contact_unit
        return self.scale * newtons / self.contact_unit

    def signal(self, newtons: Array) -> Array:
        """Noise-free readings [sensor units] of forces [N], (..., 2)."""
        unit, scale, _, bias = self._arrays
        reading: Array = newtons / unit
        reading *= scale
        if bias is not None:
            reading += bias
        return reading

    def sample(self, newtons: Array, noise: Array) -> Array:
        """One sample [sensor units] of forces [N]; ``noise`` are standard normal numbers of the same shape."""
        reading = self.signal(newtons)
        reading += self._arrays[2] * noise
        return reading

    def binary(self, raw: Array) -> Array:
        """1.0 where a reading is above its finger's threshold, else 0.0; (..., 2)."""
        return (raw > self.thresholds).astype(np.float64)


#: The three readings of the paper's factor; see the module's text.
SENSING: Final[Mapping[str, LoadCell]] = MappingProxyType(
    {
        "ta11": LoadCell(),
        "released": LoadCell(scale=0.01, contact_unit=1.0),
        "newtons": LoadCell(contact_unit=1.0),
    }
)


class MovingAverage:
    """Mean of the last ``length`` samples; of those there are while there are fewer.

    Args:
        length: number of samples; 1 is no averaging.
        simulations: how many there are, or None for one whose arrays have no such axis.
    """

    def __init__(self, length: int, simulations: int | None = None) -> None:
        self._length = length
        leading = () if simulations is None else (simulations,)
        self._samples = np.zeros((length, *leading, 2))  # the newest is the last; zeros where there was none
        self._count = np.zeros((*leading, 1))

    def reset(self, rows: Any = ...) -> None:
        """Forget every sample (of some simulations): an episode must not begin with the forces of the one before."""
        self._samples[:, rows] = 0.0
        self._count[rows] = 0.0

    def __call__(self, sample: Array, rows: Any = ...) -> Array:
        """Take a sample (of some simulations) and return the mean, same shape; with length 1 the sample itself."""
        if self._length == 1:
            return sample
        past = self._samples[:, rows]
        past = np.concatenate([past[1:], sample[None]])
        count = np.minimum(self._count[rows] + 1, self._length)
        self._samples[:, rows], self._count[rows] = past, count
        mean: Array = np.add.reduce(past, axis=0) / count
        return mean
