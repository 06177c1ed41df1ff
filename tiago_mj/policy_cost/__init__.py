"""What each effect of a diagnosis costs a policy, in return and success, and which to mend first."""

from tiago_mj.policy_cost.cost import PolicyCost, cost

__all__ = ["PolicyCost", "cost"]
