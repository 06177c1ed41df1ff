"""From recordings of a real robot to the effect that the simulator lacks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tiago_mj.gap.stepper import Stepper, apply

__all__ = ["Stepper", "apply"]


def __getattr__(name: str) -> Any:
    """What needs MuJoCo and the effects is imported when it is asked for."""
    if name in __all__:
        from tiago_mj.gap import stepper

        return getattr(stepper, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
