"""A spring that pulls a joint to one place."""

from __future__ import annotations

from benchmarks.blind.effects.base import Array, Effect, World


class ReturnSpring(Effect):
    """A linear spring; where it is slack is told as a share of the joint's range."""

    def load(self, world: World) -> Array:
        low, high = world.robot.low, world.robot.high
        slack = low + self.values["slack"] * (high - low)
        return self.on(world, self.values["stiffness"]) * (slack - world.q)
