"""Between motor and joint: friction, play, springs, inertia."""

from tiago_mj.effects.transmission import bounded_speed, friction, gear  # noqa: F401  (their import declares the effects)
