"""What an effect of the blind check is: hooks into the chain of :mod:`benchmarks.blind.reality`, all harmless."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.robots import Robot

Array = NDArray[np.float64]


@dataclass
class World:
    """The state that effects see; arrays are (ntrials, n).

    Attributes:
        robot: see there.
        h: physics step [s].
        period: control period [s].
        q, v: of the joints, true.
        newtons: on the pads, (ntrials, 2).
        force: of the drives, as delivered last.
        lifted: what the drives give on top of it to lift the robot's own weight.
        free: whether a servo is within its limit now, so that its force follows its error, (ntrials, n).
        t: true time [s].
        row: of the log.
        idle: command that is in force before the first.
        ahead: how long after it arrives a command is to be reached [s].
        rng: for what reality draws, apart from sensor noise.
    """

    robot: Robot
    h: float
    period: float
    q: Array
    v: Array
    newtons: Array
    idle: Array
    rng: np.random.Generator
    ahead: float = 0.0
    t: float = 0.0
    row: int = 0
    force: Array = field(default_factory=lambda: np.zeros(1))
    lifted: Array = field(default_factory=lambda: np.zeros(1))
    free: NDArray[np.bool_] = field(default_factory=lambda: np.ones(1, dtype=bool))

    def __post_init__(self) -> None:
        self.stiffness = self.robot.stiffness.copy()
        self.damping = self.robot.damping.copy()
        self.force = np.zeros_like(self.q)


class Effect:
    """Base of all effects.

    Args:
        values: parameters, in the contract's units.
        targets: columns that it acts on: of the joints, or of the load cells.
        seed: of what the effect has of its own (phases, places).
    """

    #: Whether it needs the physics step, even where only differences count.
    stiff = False
    #: Whether it replaces the rigid connection of motor and joint.
    two_mass = False
    #: Where it stands among the effects of one hook; small is nearer to the physics.
    order = 50
    #: Age of the measured channels when they are logged [s].
    late = 0.0

    def __init__(self, values: Mapping[str, float], targets: list[int], seed: int = 0) -> None:
        self.values = dict(values)
        self.targets = targets
        self.own = np.random.default_rng(seed)
        self.ready()

    def ready(self) -> None:
        """After construction."""

    def has(self, hook: str) -> bool:
        """Whether a hook is overridden."""
        return getattr(type(self), hook) is not getattr(Effect, hook)

    def on(self, world: World, value: float, elsewhere: float = 0.0) -> Array:
        """A value on the targeted joints, another elsewhere, (n,)."""
        out = np.full(world.q.shape[1], elsewhere)
        out[self.targets] = value
        return out

    def cells(self, value: float, elsewhere: float = 0.0) -> Array:
        """A value on the targeted load cells, another elsewhere, (2,)."""
        out = np.full(2, elsewhere)
        out[self.targets] = value
        return out

    # Hooks, in the order of the chain ---------------------------------------------------------------------------------

    def build(self, robot: Robot) -> None:
        """Change the robot before it moves."""

    def start(self, world: World) -> None:
        """Get ready for a run."""

    def sent(self, command: Array, world: World) -> Array:
        """What is put on the wire."""
        return command

    def latency(self, world: World) -> Array:
        """Age of a command when it takes hold [s], (n,)."""
        return np.zeros(world.q.shape[1])

    def shaped(self, command: Array, world: World) -> Array:
        """The command as it reaches the set point."""
        return command

    def executed(self, point: Array, world: World) -> Array:
        """The set point as it reaches the servo."""
        return point

    def control(self, force: Array, world: World) -> Array:
        """What the servo asks for, before its limit."""
        return force

    def drive(self, force: Array, world: World) -> Array:
        """What the motor delivers."""
        return force

    def motor(self, world: World) -> tuple[Array, Array]:
        """Position and velocity that the servo sees, with ``two_mass``."""
        return world.q, world.v

    def through(self, force: Array, world: World) -> Array:
        """Force that reaches the joint, with ``two_mass``."""
        return force

    def load(self, world: World) -> Any:
        """Further force on the joints."""
        return 0.0

    def joints_read(self, q: Array, v: Array, world: World) -> tuple[Array, Array]:
        """Encoders."""
        return q, v

    def forces_read(self, x: Array, world: World) -> Array:
        """Load cells."""
        return x

    def noise_factor(self, world: World) -> Any:
        """Of the load cells' noise."""
        return 1.0

    def converted(self, q: Array, v: Array, x: Array, world: World) -> tuple[Array, Array, Array]:
        """What converters make of the sensors' signals before noise comes in."""
        return q, v, x

    def sampled(self, q: Array, v: Array, x: Array, world: World) -> tuple[Array, Array, Array]:
        """What is written to the log."""
        return q, v, x

    def stamp(self, time: Array) -> Array:
        """Time stamps by the recorder's clock."""
        return time
