"""Recording an environment: what it commands and what it measures, as a robot's logger would see it.

A recording holds no trace of the effects that the environment was given: positions, velocities and readings are the
measured ones, and everything in the sidecar comes from the nominal model.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from tiago_mj import __version__
from tiago_mj.effects.host import has_diverged
from tiago_mj.envs.flat import core_of
from tiago_mj.models import names
from tiago_mj.recordings.motions.play import Motion
from tiago_mj.recordings.recording import SCHEMA, Array, Sidecar, Trial

#: Commands may exceed a limit by rounding, relative to it.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Plan:
    """What is recorded.

    Attributes:
        identifier: of the environment, with its namespace.
        arguments: of the environment, effects apart.
        effects: that reality is to have; None: none.
        motion: played instead of a policy's commands; None: a policy commands.
        label: for names of trials: the motion's or the policy's name.
    """

    identifier: str
    arguments: Mapping[str, Any]
    effects: Any
    motion: Motion | None
    label: str


def make(plan: Plan) -> gymnasium.Env[Any, Any]:
    """The environment to record, with a time limit that lets the motion end."""
    arguments = dict(plan.arguments)
    if plan.effects is not None:
        arguments["effects"] = plan.effects
    if plan.motion is None:
        return gymnasium.make(plan.identifier, **arguments)
    if plan.motion.interface is not None:
        arguments.setdefault("control", plan.motion.interface)
    if plan.motion.rate_hz is not None:
        arguments.setdefault("control_hz", plan.motion.rate_hz)
    env = gymnasium.make(plan.identifier, **arguments)
    rate = 1 / env.unwrapped.dt  # type: ignore[attr-defined]
    env.close()
    return gymnasium.make(plan.identifier, **arguments, max_episode_steps=plan.motion.steps(rate))


#: An episode: channels by kind and name, (T,); time (T,) [s]; its facts (``object``, ``goal``, ``initial``).
Episode = tuple[dict[str, dict[str, Array]], Array, dict[str, Any]]


class Logged(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment whose episodes are logged while they are played, as a robot's logger would."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        super().__init__(env)
        core = core_of(env)
        self._dofs = [int(core.model.joint(name).dofadr[0]) for name in core.joints]
        self._rows: list[tuple[Array, ...]] = []
        self._facts: dict[str, Any] = {}

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """As the environment's; the log begins anew."""
        begun = super().reset(seed=seed, options=options)
        self._rows, self._facts = [], episode_facts(core_of(self.env))
        return begun

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """As the environment's; what was sent and what was measured before it are logged.

        Raises:
            ValueError: the simulation diverges.
        """
        core, seen = core_of(self.env), self._seen()
        stepped = super().step(action)
        self._rows.append((np.array(core.command, dtype=np.float64), *seen))
        if has_diverged(core.data):
            raise ValueError(
                f"the simulation diverges in the episode of seed {core._np_random_seed}, after "
                f"{len(self._rows) * core.dt:.2g} s, so nothing is recorded: look at the sizes of --effects, and at "
                "--arguments"
            )
        return stepped

    def _seen(self) -> tuple[Array, ...]:
        core = core_of(self.env)
        effort = core.data.qfrc_actuator[self._dofs]
        return tuple(map(np.array, (core.state.position, core.state.velocity, effort, core.state.force_raw)))

    def logged(self) -> Episode:
        """The episode so far; the last row's command is NaN: nothing was sent any more."""
        core = core_of(self.env)
        rows = [*self._rows, (np.full(len(core.joints), np.nan), *self._seen())]
        commands, position, velocity, effort, force = (np.array(part) for part in zip(*rows, strict=True))
        sensors = names.SIDES if force.shape[1] else ()
        channels = {
            kind: {name: np.ascontiguousarray(values[:, k]) for k, name in enumerate(labels)}
            for kind, labels, values in (
                ("commands", core.joints, commands),
                ("positions", core.joints, position),
                ("velocities", core.joints, velocity),
                ("efforts", core.joints, effort),
                ("forces", sensors, force),
            )
        }
        return channels, np.arange(len(rows)) * core.dt, self._facts


def record_episode(env: gymnasium.Env[Any, Any], command: Callable[[Any, dict[str, Any]], Any], seed: int) -> Episode:
    """Play an episode and log it.

    Args:
        env: of :func:`make`.
        command: gives the action for what was last seen.
        seed: of the reset.

    Returns:
        As :meth:`Logged.logged`.

    Raises:
        ValueError: the simulation diverges.
    """
    log = Logged(env)
    observation, info = log.reset(seed=seed)
    over = False
    while not over:
        observation, _, terminated, truncated, info = log.step(command(observation, info))
        over = terminated or truncated
    return log.logged()


def trial_of(plan: Plan, core: Any, servo: dict[str, Any], seed: int, logged: Episode) -> Trial:
    """The recording of an episode.

    Args:
        plan: what was recorded.
        core: the environment behind its wrappers.
        servo: of the nominal model, by :func:`servo_facts`.
        seed: of the episode.
        logged: by :meth:`Logged.logged`.
    """
    channels, time, facts = logged
    name = f"{plan.label}-{seed:03d}"
    sidecar = Sidecar(
        schema=SCHEMA,
        trial=name,
        robot=plan.identifier,
        rate_hz=1 / core.dt,
        interface=core.control,
        servo=servo,
        sensing=sensing_facts(core),
        motion={"policy": plan.label} if plan.motion is None else {"file": plan.motion.name},
        source={"tool": "tiago-mj record", "version": __version__, "seed": seed},
        raw={"arguments": dict(plan.arguments)},
        **facts,
    )
    return Trial(
        name=name,
        time=time,
        sidecar=sidecar,
        source=f"{name}.parquet",
        units={},
        left_out=frozenset(),
        part_of=(),
        **channels,
    )


def record(
    plan: Plan,
    policy: Callable[[gymnasium.Env[Any, Any]], Any],
    *,
    episodes: int,
    seed: int,
    through: Callable[[gymnasium.Env[Any, Any]], gymnasium.Env[Any, Any]] = lambda env: env,
) -> Iterator[Trial]:
    """Record episodes; each later one has a seed higher by 1.

    Args:
        plan: what to record.
        policy: makes the policy for the environment; not asked where the plan has a motion.
        episodes: how many.
        seed: of the first.
        through: wraps the environment.

    Raises:
        ValueError: the environment, an effect, the motion or the policy is unusable.
    """
    env = through(make(plan))
    nominal = make(Plan(plan.identifier, plan.arguments, None, plan.motion, plan.label))
    try:
        core = core_of(env)
        player = policy(env) if plan.motion is None else MotionPlayer(core, plan.motion)
        servo = servo_facts(core_of(nominal))
        for number in range(seed, seed + episodes):
            player.reset()
            logged = record_episode(env, player, number)
            yield trial_of(plan, core, servo, number, logged)
    finally:
        env.close()
        nominal.close()


class MotionPlayer:
    """A policy that plays a motion, whatever it sees. What the motion does not command stands still."""

    def __init__(self, core: Any, motion: Motion) -> None:
        unknown = sorted(set(motion.commands) - set(core.joints))
        if unknown:
            raise ValueError(
                f"motion {motion.name}: there is no actuator {unknown[0]!r}: this robot has {', '.join(core.joints)}"
            )
        if motion.interface is not None and motion.interface != core.control:
            raise ValueError(
                f"motion {motion.name} commands a {motion.interface}, the environment takes a {core.control}: make it "
                f"with control={motion.interface!r}"
            )
        sequence = motion.at(1 / core.dt)
        low, high = _bounds(core)
        still = np.zeros(len(core.joints))
        if core.control == "position":
            still = np.array(core.initial_qpos[[int(core.model.joint(name).qposadr[0]) for name in core.joints]])
        wanted = np.tile(still, (motion.steps(1 / core.dt), 1))
        for column, name in enumerate(core.joints):
            if name not in sequence:
                continue
            wanted[:, column] = sequence[name]
            slack = ROUNDING * (high[column] - low[column])
            bad = (wanted[:, column] < low[column] - slack) | (wanted[:, column] > high[column] + slack)
            if bad.any():
                raise ValueError(
                    f"motion {motion.name}: command.{name} is {wanted[int(np.argmax(bad)), column]:.6g} at "
                    f"{int(np.argmax(bad)) * core.dt:.4g} s, the limits are {low[column]:.6g} and {high[column]:.6g}"
                )
        middle = (low + high) / 2  # 0 for velocities, so that they come out to the last bit
        self._actions = np.clip((wanted - middle) / (high - middle), -1.0, 1.0)
        self._next = 0

    def reset(self) -> None:
        """Start from the beginning."""
        self._next = 0

    def __call__(self, observation: Any, info: dict[str, Any]) -> Array:
        """The action of the next control step."""
        self._next += 1
        return np.asarray(self._actions[self._next - 1])


def _bounds(core: Any) -> tuple[Array, Array]:
    """Lowest and highest command of every joint."""
    if core.control == "velocity":
        return -core.velocity_limit, core.velocity_limit
    ranges = np.array([core.model.joint(name).range for name in core.joints])
    return ranges[:, 0], ranges[:, 1]


def episode_facts(core: Any) -> dict[str, Any]:
    """What is known of an episode at its start: the object as the task drew it, the goal, the measured pose."""
    by_joint = dict(zip(core.joints, core.state.position.tolist(), strict=True))
    speeds = dict(zip(core.joints, core.state.velocity.tolist(), strict=True))
    start = {name: float(core.initial_qpos[int(core.model.joint(name).qposadr[0])]) for name in core.joints}
    item = core.item
    thing = None
    if item is not None:
        thing = {
            "shape": item.shape,
            "radius_m": item.width / 2,
            "width_m": item.width,
            "height_m": item.height,
            "mass_kg": item.mass,
            "stiffness": item.stiffness,
            "damping": item.damping,
            "friction": item.friction,
            "offset_m": core.offset,
            "position_m": np.asarray(core.object_place(core.offset)).tolist(),
        }
    return {
        "object": thing,
        "goal": np.asarray(core.goal).tolist(),
        "initial": {"position": by_joint, "velocity": speeds, "set_point": start},
    }


def servo_facts(core: Any) -> dict[str, Any]:
    """The servos of the nominal model, by joint."""
    model = core.model
    ids = {name: model.actuator(name).id for name in core.joints}
    return {
        "name": core.servo,
        "stiffness": {name: float(model.actuator_gainprm[k, 0]) for name, k in ids.items()},
        "damping": {name: float(0.0 - model.actuator_biasprm[k, 2]) for name, k in ids.items()},
        "effort_limit": {name: float(model.actuator_forcerange[k, 1]) for name, k in ids.items()},
        "velocity_limit": dict(zip(core.joints, core.velocity_limit.tolist(), strict=True)),
    }


def sensing_facts(core: Any) -> dict[str, Any] | None:
    """The load cells; None where nothing is read."""
    if not core.state.force_raw.size:
        return None
    cell = core.load_cell
    return {
        "scale": cell.scale,
        "contact_unit": cell.contact_unit,
        "average": cell.average,
        "noise": cell.noise,
        "threshold": cell.thresholds.tolist(),
        **({"bias": cell.bias} if np.any(cell.bias) else {}),
    }
