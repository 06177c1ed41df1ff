"""A live environment without its browser: its policy, its effects, and the rows of the present episode.

Beside it runs its nominal twin: the same start, the same actions, none of the effects.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS, Entry, read_effects
from tiago_mj.effects.nominal import removable
from tiago_mj.envs.flat import core_of
from tiago_mj.learn.shipped import shipped_agents
from tiago_mj.models import scene
from tiago_mj.rollout import options
from tiago_mj.rollout.episode import Policy
from tiago_mj.rollout.policies import RANDOM, make_policy
from tiago_mj.view.pad_forces import force_goal, pad_forces

Array = NDArray[np.float64]

#: Who commands when nobody else does: the sliders.
HAND: Final = "by hand"
#: Rows that are remembered.
REMEMBERED: Final = 4000


@dataclass(frozen=True)
class Row:
    """Measurements of one control step.

    Attributes:
        time: since the start of the episode [s].
        set_point: of the commanded joints' servos, (N,) [m, rad].
        position: of the same, as measured, (N,) [m, rad].
        nominal: where the nominal twin measures them, (N,) [m, rad].
        force: on the pads, right and left, (2,) [N]; NaN where there is no object.
        reward: of the step.
        reading: of the load cells, (2,) [sensor units].
    """

    time: float
    set_point: Array
    position: Array
    nominal: Array
    force: Array
    reward: float
    reading: Array


class Session:
    """One environment and its nominal twin.

    Args:
        env, twin: the same environment twice, without a time limit.
        effects: that act at first, on ``env`` alone.
        policy: name or file, or :data:`HAND`.
        seed: of the first episode.
        trust: whether files may be unpickled.

    Attributes:
        name: of the environment.
        core, nominal: what is behind them.
        action: that the sliders give, (N,) in [-1, 1].
        rows: what happened since the last reset.
        limit: steps of an episode as it is registered.
        policies: names of those that can be chosen.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        twin: gymnasium.Env[Any, Any],
        *,
        effects: Sequence[Entry] = (),
        policy: str = HAND,
        seed: int = 0,
        trust: bool = False,
    ) -> None:
        assert env.spec is not None, "an environment of the table"
        self.name = env.spec.id.partition("/")[2]
        self._env, self._twin, self._seed, self._trust = env, twin, seed, trust
        self.core, self.nominal = core_of(env), core_of(twin)
        self.joints: tuple[str, ...] = self.core.joints
        self.action = np.zeros(len(self.joints))
        self.rows: deque[Row] = deque(maxlen=REMEMBERED)
        self.limit = int(gymnasium.spec(env.spec.id).max_episode_steps or 0)
        self._policy: Policy | None = None
        self.commander = HAND
        self.effects: tuple[Entry, ...] = ()
        if effects:
            self.give(effects)
        self.reset()
        self.command_by(policy)
        self.policies = self._known(policy)

    def _known(self, given: str) -> tuple[str, ...]:
        """Policies that fit this environment, the requested one included."""
        found = [HAND]
        for name in ("pi", "pi-tuned", RANDOM, *shipped_agents()):
            try:
                make_policy(name, self._env, seed=self._seed, trust=False)
            except ValueError:  # not of this environment
                continue
            found.append(name)
        return tuple(dict.fromkeys([*found, given]))

    def command_by(self, name: str) -> None:
        """Use another policy from the next step on.

        Raises:
            ValueError: there is no such policy, or it does not fit the environment; the one before commands on.
        """
        if name == HAND:
            self._policy = None
        else:
            made = make_policy(name, self._env, seed=self._seed, trust=self._trust)
            made.reset()
            self._policy = made
        self.commander = name

    def give(self, effects: Sequence[Entry]) -> None:
        """Use other effects from now on; the episode continues.

        Raises:
            ValueError: they do not fit this robot; those before act on.
        """
        self.core.give_effects(list(effects) or None)
        self.effects = tuple(effects)

    def reset(self) -> None:
        """Begin a new episode of the environment and its twin, with the same seed."""
        self._observation, self._info = self._env.reset(seed=self._seed)
        self._twin.reset(seed=self._seed)
        self._seed += 1
        self.rows.clear()
        self.steps = 0
        self.action[:] = self._idle()
        if self._policy is not None:
            self._policy.reset()

    def step(self) -> Row:
        """Advance the environment and its twin by one control step."""
        action = self.action if self._policy is None else self._policy(self._observation, self._info)
        self._observation, reward, _, _, self._info = self._env.step(action)
        self._twin.step(action)
        self.steps += 1
        core, none = self.core, np.full(2, np.nan)
        force, reading = np.asarray(core.state.force_contact), np.asarray(core.state.force_raw)
        row = Row(
            time=self.steps * core.dt,
            set_point=core.set_points,
            position=np.array(core.state.position),
            nominal=np.array(self.nominal.state.position),
            force=force if force.shape == (2,) else none,
            reward=float(reward),
            reading=reading if reading.shape == (2,) else none,
        )
        self.rows.append(row)
        return row

    def close(self) -> None:
        """Release what they hold."""
        self._env.close()
        self._twin.close()

    def _idle(self) -> Array:
        """The action that keeps every joint where it is."""
        if self.core.control == "velocity":
            return np.zeros(len(self.joints))
        low, high = self.core.drive.low, self.core.drive.high
        return np.clip(2 * (np.asarray(self.core.state.position) - low) / (high - low) - 1, -1, 1)

    # What is drawn beside the robot ---------------------------------------------------------------------------------

    def force_goal(self) -> float | None:
        """Force that the task asks of each finger [N]; None where it asks for none."""
        return force_goal(self.core)

    def place_goal(self) -> Array | None:
        """Where the task wants the hand or the object, (3,) [m]; None where its goal is no place."""
        site = mujoco.mj_name2id(self.core.model, mujoco.mjtObj.mjOBJ_SITE, scene.GOAL_SITE)
        return None if site < 0 else np.array(self.core.goal, dtype=float)

    def pad_forces(self) -> list[tuple[str, Array, Array]]:
        """Side, place of the pad (3,) [m], and the force on it (3,) [N] in the world."""
        return [(one.side, one.place, one.newtons * one.outwards) for one in pad_forces(self.core)]

    def contacts(self) -> Array:
        """Positions of active contacts, (n, 3) [m]."""
        data = self.core.data
        points = [data.contact.pos[k] for k in range(data.ncon) if data.contact.efc_address[k] >= 0]
        return np.array(points).reshape(-1, 3)


def session(
    env: str,
    given: Sequence[str] = (),
    *,
    effects: Any = None,
    policy: str | None = None,
    seed: int = 0,
    trust: bool = False,
) -> Session:
    """Session of a new environment and its twin.

    Args:
        env: its id.
        given: ``key=value`` arguments of it.
        effects: that act at first, in any form that environments take.
        policy: who commands at first; None: the sliders.
        seed: of the first episode.
        trust: whether files may be unpickled.

    Raises:
        ValueError: something does not fit; one line.
    """
    if seed < 0:
        raise ValueError(f"--seed is {seed}: give 0 or more")
    identifier = options.environment_id(env)
    arguments = options.read_options(given)
    entries = [*read_effects(arguments.pop("effects", None)), *read_effects(effects)]

    def made() -> gymnasium.Env[Any, Any]:
        return options.make_env(identifier, arguments, max_episode_steps=-1, disable_env_checker=True)

    return Session(made(), made(), effects=entries, policy=policy or HAND, seed=seed, trust=trust)


# Effects as a panel offers them -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Knob:
    """A parameter of an effect on its targets: bounds and default [unit]."""

    name: str
    unit: str
    low: float
    high: float
    default: float


def offered(session: Session) -> tuple[str, ...]:
    """Names of the effects that have a target on this robot."""
    targets = session.core.wiring().targets
    has_object = session.core.object_choice is not None
    return tuple(
        name
        for name, declared in EFFECTS.items()
        if targets.names(declared.targets) and (declared.targets != "object" or has_object)
    )


def whom(session: Session, effect: str) -> dict[str, tuple[str, ...] | None]:
    """Possible targets of an effect by label: all or one; all slides or all hinges where there are both."""
    targets = session.core.wiring().targets
    kind = EFFECTS[effect].targets
    them = targets.names(kind)
    slides = [targets.side(kind, index) == 0 for index in range(len(them))]
    found: dict[str, tuple[str, ...] | None] = {}
    if all(slides) or not any(slides):
        found["all"] = None
    else:
        found["all that slide"] = tuple(n for n, slide in zip(them, slides, strict=True) if slide)
        found["all that turn"] = tuple(n for n, slide in zip(them, slides, strict=True) if not slide)
    if len(them) > 1:
        found |= {name: (name,) for name in them}
    return found


def knobs(session: Session, effect: str, target: tuple[str, ...] | None) -> tuple[Knob, ...]:
    """Parameters of an effect on a target with their declared bounds, limited to what the model can lose."""
    model, wiring = session.nominal.model, session.core.wiring()
    targets, declared = wiring.targets, EFFECTS[effect]
    names = targets.names(declared.targets)
    whose = range(len(names)) if target is None else [names.index(one) for one in target]
    index, there = whose[0], min(removable(declared, model, wiring, k) for k in whose)
    side = targets.side(declared.targets, index)
    first, found = next(iter(declared.parameters)), []
    for name, parameter in declared.parameters.items():
        low, high = parameter.bounds[side]
        default = parameter.default[side]
        if parameter.nominal is not None:
            limit = targets.nominal(parameter.nominal, declared.targets, index)
            if not np.isfinite(limit):
                continue
            low, high, default = low * limit, high * limit, default * limit
        if name == first:
            low = max(low, -there)
        found.append(Knob(name, parameter.unit[side], float(low), float(high), float(default)))
    return tuple(found)


def entry(effect: str, target: tuple[str, ...] | None, values: dict[str, float]) -> Entry:
    """An effect with values, as environments take it."""
    return replace(Entry(effect), target=target, parameters=dict(values))
