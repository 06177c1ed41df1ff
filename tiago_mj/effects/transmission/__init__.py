"""Between motor and joint: friction, play, springs, inertia."""

from tiago_mj.effects.transmission import (  # noqa: F401  (their import declares the effects)
    bounded_speed,
    coupled_motor,
    friction,
    gear,
    spring,
)
