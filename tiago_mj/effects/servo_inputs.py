"""From commands to the servos' inputs: set points, how far they move in a control period, and what is on its way."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.chain import EACH_STEP, EACH_SUBSTEP, Chain
from tiago_mj.effects.host import Host, span
from tiago_mj.effects.now import Wiring

Array = NDArray[np.float64]


class ServoInputs:
    """Inputs of the servos of many simulations, for the commands of one control period after another.

    A servo with a set point of its own (``act``) is given the speed at which the set point moves; a plain position
    servo is given the set point itself; a motor is given its force.

    Args:
        chain: the effects; of those on commands and set points the hooks are called here.
        host: the simulations.
        wiring: their parts.
    """

    def __init__(self, chain: Chain, host: Host, wiring: Wiring) -> None:
        self._chain, self._host, self._wiring = chain, host, wiring
        self._stateful = wiring.act >= 0
        self._all_stateful = bool(self._stateful.all())
        self._moves_set_point = chain.where("set_point")
        self._on_its_way = chain.where("given")
        through = (chain.where(hook) for hook in ("command", "set_point", "given"))
        self._bare = all(where is None for where in through) and (self._all_stateful or wiring.interface != "position")
        self._foreseen: Array | None = None
        takes = wiring.servo & (wiring.act < 0) & (wiring.interface != "effort")
        chain.now.takes_set_points, self._plain_servos = takes, bool(takes.any())
        # A plain position servo takes what it is given at once, as it does in MuJoCo.
        self._speed_limit = np.where(takes, np.inf, wiring.targets.velocity)[None]
        self._speed_floor = -self._speed_limit
        self._act = span(wiring.act.tolist())
        joints = list(wiring.targets.actuated)
        self._qpos, self._dof = span(wiring.qpos[joints].tolist()), span(wiring.dof[joints].tolist())

    def start(self, held: Array | None = None) -> None:
        """Forget the commands of the episode before.

        Args:
            held: set points of plain position servos before the first command, (nsim, nactuators) [m, rad]; None: where
                the joints are.
        """
        now, wiring = self._chain.now, self._wiring
        if wiring.ideal:
            self._measure_slack()
        if self._all_stateful and not self._chain.effects:
            return  # nothing is remembered of the commands
        self._plain = self._host.state("qpos")[:, wiring.qpos[list(wiring.targets.actuated)]]
        if held is not None:
            self._plain = np.array(held)
        self._target = self.set_points()
        self._shift = np.zeros_like(self._target)
        now.set_point = self._target.copy()
        now.idle = self._target.copy() if wiring.interface == "position" else np.zeros_like(self._target)
        now.resting = np.where(now.takes_set_points, self._plain, 0.0)
        self._coming = self._target.copy()

    # With the simulation --------------------------------------------------------------------------------------------

    def set_points(self) -> Array:
        """The servos' set points, (nsim, nactuators) [m, rad]; the joint's first position where there is no servo."""
        wiring, stateful = self._wiring, self._stateful
        if self._foreseen is not None:
            return np.where(stateful, self._foreseen, self._plain)
        if self._all_stateful:
            return self._host.state("act")[:, wiring.act]
        plain = self._plain.copy()
        plain[:, stateful] = self._host.state("act")[:, wiring.act[stateful]]
        return plain

    def hold(self) -> None:
        """Keep an ideal servo's set points from running away: what the effort limit cannot hold is forgotten.

        The servo's force kp (set point − q) − kv q̇ stays within ± the limit.
        """
        host, act = self._host, self._host.state("act")
        joint = host.state("qpos")[:, self._qpos] + self._lag * host.state("qvel")[:, self._dof]
        present = act[:, self._act]
        held = np.minimum(np.maximum(present, joint - self._slack), joint + self._slack)
        if not self._bare:
            self._coming = self._coming + (held - present)
            if self._wiring.interface == "velocity":
                # Commands and what effects remember of them stay in a frame of their own, which the forgetting moves.
                self._shift = self._shift + (held - present)
        act[:, self._act] = held

    def _measure_slack(self) -> None:
        """How far an ideal servo's set point may lead, and its lag [m, rad], [s]; of each simulation's own servo."""
        gain, bias, limits = (
            # Without effects all have the model's: asking a batch for each one's own would copy it for good.
            self._host.field(name) if self._chain.effects else getattr(self._host.model, name)[None]
            for name in ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange")
        )
        ids = self._wiring.actuators
        stiffness = gain[:, ids, 0]
        self._slack, self._lag = limits[:, ids, 1] / stiffness, -bias[:, ids, 2] / stiffness

    def of(self, command: Array) -> Array:
        """Inputs for a command, (nsim, nactuators), before what delays them on their way."""
        now, wiring = self._chain.now, self._wiring
        if self._bare and not self._plain_servos:  # nothing is remembered of the commands
            if wiring.interface != "position":
                return command
            present = self._host.state("act")[:, self._act] if self._foreseen is None else self._foreseen
            period = now.dt.item() if now.nsim == 1 else now.period
            return _within((command - present) / period, self._speed_floor, self._speed_limit)
        command = self._chain.command(command)
        if wiring.interface == "effort":
            return command
        present = self._ahead()
        if wiring.interface == "velocity":
            wanted = self._target + command * now.period
            ctrl, reached = command, present + command * now.period
        else:
            wanted = command
            ctrl, reached = _towards(command, present, now.period, self._speed_limit)
        low, high = wiring.span.T
        self._target = _within(wanted, low - self._shift, high - self._shift)
        if self._moves_set_point is not None:
            effective = self._chain.set_point(self._target) + self._shift
            moved, there = _towards(effective, present, now.period, self._speed_limit)
            ctrl = np.where(self._moves_set_point, moved, ctrl)
            reached = np.where(self._moves_set_point, there, reached)
        self._coming = _within(reached, low, high)
        if self._plain_servos:
            self._plain = np.where(now.takes_set_points, self._coming, self._plain)
            ctrl = np.where(now.takes_set_points, self._plain, ctrl)
        return ctrl

    def _ahead(self) -> Array:
        """Where set points will be once all that is on its way has arrived, (nsim, nactuators) [m, rad]."""
        present = self.set_points()
        return present if self._on_its_way is None else np.where(self._on_its_way, self._coming, present)

    def arriving(self, inputs: Array) -> Array | None:
        """What the servos are given in each physics step, (nsim, nsubsteps, nactuators); None: the inputs, held."""
        if self._on_its_way is None:
            return None
        return self._given(np.repeat(inputs[:, None], self._chain.now.substeps, axis=1))

    def _given(self, inputs: Array) -> Array:
        for effect, mask in self._chain.users("given"):
            inputs = np.where(mask[:, None], effect.given(inputs, self._chain.now), inputs)
        return inputs

    # Without it -----------------------------------------------------------------------------------------------------

    @property
    def open_loop(self) -> bool:
        """Whether what the servos are given depends on commands alone, so that a run needs no one between its steps.

        Set points that an actuator integrates (``act``) depend on what it is given alone, too: they are foreseen.
        """
        wiring, chain = self._wiring, self._chain
        integrates = self._host.model.actuator_dyntype[wiring.actuators] == mujoco.mjtDyn.mjDYN_INTEGRATOR
        if wiring.ideal or (self._stateful & ~integrates).any():
            return False
        return all(effect.signal_only for hook in (*EACH_SUBSTEP, *EACH_STEP) for effect, _ in chain.users(hook))

    def ahead(self, commands: Array) -> Array:
        """Inputs that an open loop gives the servos in each physics step of the next commands, (nsim, rows,
        nactuators) to (nsim, rows * nsubsteps, nactuators)."""
        now = self._chain.now
        if not self._passes_commands:
            return self._foreseeing(commands)
        plain = now.takes_set_points
        each = np.where(plain, np.clip(commands, *self._wiring.span.T), commands) if plain.any() else commands
        now.step += commands.shape[1]
        now.elapsed = now.elapsed + commands.shape[1] * now.dt
        return self._given(np.repeat(each, now.substeps, axis=1))

    def _foreseeing(self, commands: Array) -> Array:
        """The same where a command meets what was commanded before: set points are followed without the simulation."""
        now, rows = self._chain.now, []
        self._foreseen = self.set_points()
        for k in range(commands.shape[1]):
            arriving = self._given(np.repeat(self.of(commands[:, k])[:, None], now.substeps, axis=1))
            rows.append(arriving)
            self._foreseen = self._integrated(self._foreseen, arriving)
            now.step += 1
            now.elapsed = now.elapsed + now.dt
        self._foreseen = None
        return np.concatenate(rows, axis=1)

    def _integrated(self, set_points: Array, inputs: Array) -> Array:
        """Set points that actuators integrate, after physics steps with these inputs, (nsim, nsteps, nactuators); as
        MuJoCo's Euler steps of ``act``, within ``actrange``."""
        ids, model = self._wiring.actuators, self._host.model
        slowest, fastest = np.moveaxis(self._host.field("actuator_ctrlrange")[:, None, ids], -1, 0)
        speeds = np.where(model.actuator_ctrllimited[ids], np.clip(inputs, slowest, fastest), inputs)
        limited, ends = model.actuator_actlimited[ids], self._host.field("actuator_actrange")[:, ids]
        low, high = np.where(limited, ends[..., 0], -np.inf), np.where(limited, ends[..., 1], np.inf)
        step = self._chain.now.dt[:, None] / self._chain.now.substeps
        for k in range(inputs.shape[1]):
            set_points = np.clip(set_points + speeds[:, k] * step, low, high)
        return set_points

    @property
    def _passes_commands(self) -> bool:
        """Whether each command of an open loop is what the servos are given, whatever was commanded before."""
        wiring, chain = self._wiring, self._chain
        moved = chain.now.takes_set_points.any() and wiring.interface == "velocity"
        followed = self._stateful.any() and wiring.interface == "position"
        return not (moved or followed or chain.users("command") or chain.users("set_point"))


def _towards(target: Array, present: Array, period: Array, limit: Array) -> tuple[Array, Array]:
    """Speed that reaches the target within a control period, or the limit; and what it reaches."""
    speed = _within((target - present) / period, -limit, limit)
    return speed, np.where(np.isfinite(limit), present + speed * period, target)


def _within(values: Array, low: Array, high: Array) -> Array:
    """As np.clip, which is a Python function around another."""
    return np.minimum(np.maximum(values, low), high)
