"""What each effect of a diagnosis costs a policy, in return and success, and which to mend first."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from tiago_mj.policy_cost.effect_costs import PolicyCost, cost

__all__ = ["PolicyCost", "cost"]

#: Episodes in each simulator, and draws of the magnitudes, unless told. 20 and 10: with the shipped agents an interval
#: of a few per cent of the return, in a minute or two (docs/policy-cost.md).
EPISODES: Final = 20
DRAWS: Final = 10


def __getattr__(name: str) -> Any:
    """What needs environments and effects is imported when it is asked for."""
    if name in __all__:
        from tiago_mj.policy_cost import effect_costs as room

        return getattr(room, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
