"""The classical force controller that the paper compares with: close, wait for both contacts, then PI on the force.

Paper, section IV ("Force Control Policy Evaluation"): the fingers close; the one that feels the object first stops
until the other does too, so that the object is not pushed; then a PI law on each finger's force error reaches and keeps
the goal. The paper gives no gains. These were set on the nominal gripper (docs/sensing.md says how and what they give).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from tiago_mj.models import names
from tiago_mj.sensing.load_cell import SERVO_STIFFNESS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Gains:
    """Of the PI law, per newton of force error, so that they mean the same for every scale of the sensor.

    Behind a velocity command the force changes as f' = k v, where k is the position servo's stiffness (``servo="pal"``:
    2000 N/m) or the object's (``"ideal"``): k · proportional is the rate at which the error closes [1/s]. The integral
    takes away what a drifting contact leaves.

    Attributes:
        proportional: finger speed over force error [m/s/N].
        integral: finger speed over integrated force error [m/s/(N·s)].
        closing_speed: before contact [m/s]; None: the environment's finger speed limit.
        touch: force at which a finger waits for the other [N].
    """

    proportional: float = 0.01
    integral: float = 0.02
    closing_speed: float | None = None
    touch: float = 0.5

    @classmethod
    def for_plant(cls, stiffness: float, damping: float, dt: float) -> Gains:
        """The defaults, lowered where the plant f = k x + c x' at this rate needs it.

        One period of dead time lies between a force and the answer to it, so both k · proportional · dt and
        c · proportional must stay well below 1; at most 0.4 and 0.25 leave the margin that a contact's onset needs.

        Args:
            stiffness: k [N/m].
            damping: c [N·s/m].
            dt: control period [s].
        """
        proportional = min(cls.proportional, 0.4 / (stiffness * dt), 0.25 / damping if damping > 0 else np.inf)
        return cls(proportional=proportional, integral=cls.integral * proportional / cls.proportional)


class ForcePI:
    """Commands the fingers of a tactile environment; every other joint is commanded to stand still.

    It reads ``info``: ``force_raw``, ``force_binary`` and ``goal``. Leading batch axes are allowed throughout, so that
    one controller serves a vector environment. Sign: a positive finger velocity opens.

    Args:
        speed_limit: of each finger [m/s], (2,).
        newtons_per_unit: newtons in one sensor unit.
        dt: control period [s].
        fingers: columns of the action that are the right and the left finger.
        action_size: number of entries of the action.
        gains: see :class:`Gains`.
    """

    def __init__(
        self,
        *,
        speed_limit: Array,
        newtons_per_unit: float,
        dt: float,
        fingers: tuple[int, int] = (0, 1),
        action_size: int = 2,
        gains: Gains | None = None,
    ) -> None:
        self.gains = Gains() if gains is None else gains
        self._limit = np.asarray(speed_limit, dtype=np.float64)
        self._newtons = newtons_per_unit
        self._dt = dt
        self._fingers = list(fingers)
        self._size = action_size
        self.reset()

    @classmethod
    def for_env(cls, env: gymnasium.Env[Any, Any], gains: Gains | None = None) -> ForcePI:
        """A controller with the environment's limits, scale and rate.

        Raises:
            ValueError: the environment has no load cells, or is commanded by position.
        """
        core: Any = env.unwrapped
        if getattr(core, "force_type", "none") == "none" or np.shape(core.goal) != (2,):
            raise ValueError(
                "the PI force controller needs an environment with load cells whose goal is a force, such as "
                "tiago_mj/GripperTactile-v0"
            )
        if core.control != "velocity":
            raise ValueError(
                "the PI force controller commands velocities: make the environment with control='velocity'"
            )
        fingers = [core.joints.index(name) for name in names.FINGERS]
        return cls(
            speed_limit=core.velocity_limit[fingers],
            newtons_per_unit=1 / core.load_cell.units(1.0),
            dt=core.dt,
            fingers=(fingers[0], fingers[1]),
            action_size=len(core.joints),
            gains=Gains.for_plant(*_plant(core), core.dt) if gains is None else gains,
        )

    def reset(self) -> None:
        """Forget the episode before."""
        self._both: Any = np.zeros((1,), dtype=bool)
        self._integral: Array = np.zeros(2)

    def __call__(self, observation: Any, info: dict[str, Any]) -> Array:
        """The action, (..., n_actions) float32 within [-1, 1].

        Args:
            observation: unused; the same call serves learned policies.
            info: of the last ``reset`` or ``step``.
        """
        touched = info["force_binary"] > 0
        self._both = self._both | touched.all(axis=-1, keepdims=True)
        force = info["force_raw"] * self._newtons
        velocity = np.where(self._both, self._hold(force, info["goal"] * self._newtons), self._approach(force, touched))
        action = np.zeros((*velocity.shape[:-1], self._size), dtype=np.float32)
        action[..., self._fingers] = np.clip(velocity / self._limit, -1.0, 1.0)
        return action

    def _approach(self, force: Array, touched: NDArray[np.bool_]) -> Array:
        """Close; a finger that touches keeps a light force, which is to stop with a set point that ran ahead."""
        closing = self._limit if self.gains.closing_speed is None else np.minimum(self.gains.closing_speed, self._limit)
        return np.where(touched, self.gains.proportional * (force - self.gains.touch), -closing)

    def _hold(self, force: Array, goal: Array) -> Array:
        """PI on the force error. Anti-windup: the integral stands still where it would push on a saturated command."""
        error = goal - force
        wanted = self.gains.proportional * error + self.gains.integral * self._integral
        winding_up = (np.abs(wanted) >= self._limit) & (np.sign(wanted) == np.sign(error))
        self._integral = np.where(self._both & ~winding_up, self._integral + error * self._dt, self._integral)
        return -(self.gains.proportional * error + self.gains.integral * self._integral)


def _plant(core: Any) -> tuple[float, float]:
    """Stiffness [N/m] and damping [N·s/m] that a commanded finger velocity meets once the object is touched."""
    if core.servo == "pal":  # the servo is the softest spring, and its set point meets no damper
        return SERVO_STIFFNESS, 0.0
    return core.object_choice.most("stiffness"), core.object_choice.most("damping")
