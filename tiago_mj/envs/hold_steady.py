"""Hold a force without ever letting go: the paper's task with a reward that a juggled object does not earn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from tiago_mj.envs.choices import Objects, Range
from tiago_mj.envs.hold_force import HoldForce
from tiago_mj.envs.robot_env import VELOCITY_BOUND
from tiago_mj.envs.state import State
from tiago_mj.io.quoting import is_number, quoted
from tiago_mj.models import names
from tiago_mj.sensing.columns import columns, joined, positive

Array = NDArray[np.float64]

#: Where the achieved vector has the readings.
FORCE: Final = slice(0, 2)

#: Of the observation space: farther from the goal, in goals, no force is.
RELATIVE_BOUND: Final = 1e4


@dataclass(frozen=True)
class SteadyWeights:
    """How much each term of the reward counts; each is at most 0 and about 1 a finger and step at its worst.

    Attributes:
        force: −Σ_i |f_i − goal| / goal: the paper's reward, in units of the goal; to the power of ``exponent``.
        approach: −Σ_i (1 + q̇_i / `finger_speed`) / 2 of the fingers that do not touch: 0 for one that closes at the
            limit, 1 for one that opens at it. In sum it is the time until touch; it tells an agent so at every step,
            where all else is the same until there is something to feel.
        contact: −(number of pads that do not touch the object). Touching early and never letting go earns most.
        excess: −Σ_i max(0, f_i − goal) / goal: too much force counts more than too little, so pulses do not pay.
        finger_motion: −Σ_i |q̇_i| / `finger_speed` of the fingers that touch: a finger that chatters does not pay.
        object_motion: −|v| / `finger_speed` of the object: an object that is batted moves.
    """

    force: float = 1.0
    approach: float = 1.0
    contact: float = 0.5
    excess: float = 0.5
    finger_motion: float = 0.25
    object_motion: float = 0.5

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not is_number(value) or value < 0:
                raise ValueError(f"weights: {name} is {quoted(value)}: give a finite number, 0 or more")

    @classmethod
    def of(cls, given: SteadyWeights | Mapping[str, float] | None) -> SteadyWeights:
        """The weights that a user gave: these, some of them by name, or None for the defaults.

        Raises:
            ValueError: a name is none of the terms', or a value is no weight.
        """
        if given is None or isinstance(given, SteadyWeights):
            return given or cls()
        known = tuple(asdict(cls()))
        if not isinstance(given, Mapping):
            raise ValueError(f"weights is {quoted(given)}: give a mapping with any of {', '.join(known)}")
        for name in given:
            if name not in known:
                raise ValueError(f"weights: {quoted(name)} is no term of the reward: use any of {', '.join(known)}")
        return cls(**given)


class HoldForceSteady(HoldForce):
    """Close on an object, touch it, and hold a goal force without letting go.

    ## Description

    The paper's agent reached its reward by bouncing the object between the fingers (section IV-A): impacts make pulses
    of force near the goal. Here the goal and the object differ from episode to episode, and the reward has terms that a
    bounced object does not earn. The paper's reward of the same step is ``info["paper_reward"]``.

    ## Action Space

    As :class:`HoldForce`: `Box(-1, 1, (2,), float32)`, desired velocity of the right and left finger over
    `finger_speed`; negative closes. Other joints come before the fingers.

    ## Observation Space

    `Box((6,), float64)`:

    | entries | meaning | unit |
    |---|---|---|
    | 0, 1 | finger velocities right, left over `finger_speed` | 1 |
    | 2, 3 | goal right, left | sensor units |
    | 4, 5 | (force − goal) / goal, right, left; force as `force_type` says, absent if `"none"` | 1 |

    With `robot` and `joints` of TIAGo, whose last two are the fingers, the positions of its other joints [m, rad] come
    first, and their velocities over their limits before the fingers'.

    The paper's observation has finger positions and force − goal. Where a finger is says where this object lies and how
    wide it is, but nothing of what to do, and an agent that sees it learns the places that it was trained on. And
    force − goal is that of no contact in one episode and that of a small lack in another; over the goal, no contact is
    −1 in all.

    ## Rewards

    The sum of the terms of :class:`SteadyWeights`, each times its weight; every term's value is in
    ``info["reward_terms"]``. Success (`info["is_success"]`): both readings within 5 standard deviations of the sensor's
    noise of the goal, and both pads on the object.

    ## Starting State

    As :class:`HoldForce`; goal, shape, width, mass, stiffness and place of the object are drawn at every reset.

    ## Episode End

    Never terminates; truncated after 300 steps by the registered time limit.

    ## Arguments

    See :class:`HoldForceSteady.__init__`, :class:`HoldForce` and :class:`tiago_mj.envs.arguments.SimulationArguments`.

    ## Version History

    * v0: first.
    """

    #: What is drawn at every reset unless other values are given.
    GOALS: Final = (0.5, 1.5)
    OBJECTS: Final = ("cylinder", "box")
    WIDTHS: Final = (0.03, 0.05)
    MASSES: Final = (0.2, 0.6)
    STIFFNESSES: Final = (5_000.0, 15_000.0)
    OFFSETS: Final = (-0.008, 0.008)

    def __init__(
        self,
        *,
        weights: SteadyWeights | Mapping[str, float] | None = None,
        observe_fingers: bool = False,
        exponent: float = 1.0,
        goal: Range | None = GOALS,
        object: Objects = OBJECTS,
        object_width: Range | None = WIDTHS,
        object_mass: Range | None = MASSES,
        object_stiffness: Range | None = STIFFNESSES,
        object_offset: Range = OFFSETS,
        **kwargs: Any,
    ) -> None:
        """Set the task up.

        Args:
            weights: of the reward's terms; a mapping may give some of them.
            observe_fingers: whether the fingers' positions over their travel are observed, too, after those of other
                joints: what an agent that feels nothing goes by.
            exponent: of the term ``force``. Below 1, a small error counts for more, and a large one for less: with 0.5,
                agents end nearer to the goal.
            goal: [sensor units]; None: 6.06 N per finger.
            object, object_width, object_mass, object_stiffness, object_offset: as :class:`HoldForce` takes them.
            **kwargs: of :class:`HoldForce` and :class:`RobotEnv`, without ``reward_type``: the weights say it.
        """
        if "reward_type" in kwargs:
            raise ValueError("reward_type is not for the steady task: give weights to its terms instead")
        joints = tuple(kwargs.get("joints", names.FINGERS))
        if joints[-2:] != names.FINGERS:
            raise ValueError(f"joints {joints}: the steady task is of the fingers; give them last: {names.FINGERS}")
        if not is_number(exponent) or exponent <= 0:
            raise ValueError(f"exponent is {quoted(exponent)}: give a number above 0")
        self.weights, self.observe_fingers, self.exponent = SteadyWeights.of(weights), observe_fingers, exponent
        super().__init__(
            goal=goal,
            object=object,
            object_width=object_width,
            object_mass=object_mass,
            object_stiffness=object_stiffness,
            object_offset=object_offset,
            **kwargs,
        )

    def _initialize_simulation(self) -> None:
        super()._initialize_simulation()
        fingers = [self.joints.index(name) for name in names.FINGERS]
        self._fingers = slice(fingers[0], fingers[1] + 1)
        self._speed_unit = float(self.velocity_limit[self._fingers].max())
        self._seen = slice(0, len(self.joints) if self.observe_fingers else fingers[0])
        self._position_units = np.ones(len(self.joints))
        self._position_units[self._fingers] = self._range[self._fingers].max()
        self._speed_units = self.velocity_limit.copy()
        self._speed_units[self._fingers] = self._speed_unit

    # What is observed ------------------------------------------------------------------------------------------------

    def observed(self, state: State, goal: Array) -> dict[str, Array]:
        """See the base; the agent sees the goal as well, as it is another one in every episode."""
        forces = self._forces(state)
        seen = [(state.position / self._position_units)[..., self._seen], state.velocity / self._speed_units, goal]
        if forces is not None:
            seen.append((forces - goal) / goal if goal.size else forces)  # while it is being made, there is no goal
        return {
            "observation": np.concatenate(seen, axis=-1),
            "achieved_goal": self._achieved(state),
            "desired_goal": goal.copy(),
        }

    def _observation_bound(self) -> Array:
        joints, count = self._joint_bound(), len(self.joints)
        seen = [
            (joints[:count] / self._position_units)[self._seen],
            joints[count:] / self._speed_units,
            self._goal_bound(),
        ]
        return np.concatenate(seen if self.force_type == "none" else [*seen, np.full(2, RELATIVE_BOUND)])

    def _observation_space(self) -> spaces.Dict:
        space = super()._observation_space()
        bound = np.concatenate([self._goal_bound(), np.ones(2), np.full(3, VELOCITY_BOUND)])
        space.spaces["achieved_goal"] = spaces.Box(-bound, bound, dtype=np.float64)
        return space

    def _achieved(self, state: State) -> Array:
        """What the reward is about, (..., 7).

        Readings [sensor units], touching or not, and velocities [m/s] of the right and left finger; the object's speed
        [m/s].
        """
        readings = columns(super()._achieved(state))
        touching = [(newtons > 0) * 1.0 for newtons in columns(state.force_contact)]
        velocities = columns(state.velocity[..., self._fingers])
        x, y, z = columns(state.object_velocity[..., :3])
        return joined([*readings, *touching, *velocities, np.sqrt(x * x + y * y + z * z)])

    # What is rewarded ------------------------------------------------------------------------------------------------

    def _reward_terms(self, achieved: Array, desired: Array) -> dict[str, Array]:
        error = (achieved[..., FORCE] - desired) / desired
        (right, left), (right_far, left_far) = columns(error), columns(np.abs(error) ** self.exponent)
        _, _, right_touch, left_touch, right_speed, left_speed, object_speed = columns(achieved)
        right_speed, left_speed = right_speed / self._speed_unit, left_speed / self._speed_unit
        right_behind = positive(1.0 + right_speed) / 2 * (1.0 - right_touch)
        left_behind = positive(1.0 + left_speed) / 2 * (1.0 - left_touch)
        weights = self.weights
        return {
            "force": -weights.force * (right_far + left_far),
            "approach": -weights.approach * (right_behind + left_behind),
            "contact": -weights.contact * ((1.0 - right_touch) + (1.0 - left_touch)),
            "excess": -weights.excess * (positive(right) + positive(left)),
            "finger_motion": -weights.finger_motion * (abs(right_speed) * right_touch + abs(left_speed) * left_touch),
            "object_motion": -weights.object_motion * object_speed / self._speed_unit,
        }

    def _is_success(self, achieved_goal: Array, desired_goal: Array) -> Any:
        right, left, right_touch, left_touch, *_ = columns(achieved_goal)
        right_goal, left_goal = columns(desired_goal)
        right_good = (abs(right - right_goal) < self.tolerance) & (right_touch > 0)
        left_good = (abs(left - left_goal) < self.tolerance) & (left_touch > 0)
        good = right_good & left_good
        return good if isinstance(good, np.ndarray) else bool(good)

    def described(self, state: State, achieved: Array, goal: Array) -> dict[str, Any]:
        """See the base; with the reward that the paper's task gives for the same step."""
        info = super().described(state, achieved, goal)
        error = np.abs(achieved[..., FORCE] - goal)
        info["paper_reward"] = -(error[..., 0] + error[..., 1])
        return info
