"""The return that each effect costs a policy: the same episodes with it and without it, all else equal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import Entry
from tiago_mj.policy_cost import DRAWS, EPISODES
from tiago_mj.policy_cost.doubts import others_of, result_of
from tiago_mj.policy_cost.intervals import Interval, of_returns, of_successes
from tiago_mj.policy_cost.magnitudes import Item, draws, items_of
from tiago_mj.policy_cost.play import Outcome, play_all
from tiago_mj.rollout.policies import as_policy

Array = NDArray[np.float64]

#: Plays all episodes in each of many simulators, named by what they have beside the nominal model. The episodes are the
#: same in each, and in the same order.
Simulate = Callable[[Sequence[tuple[Entry, ...]]], Sequence[Sequence[Outcome]]]


@dataclass(frozen=True)
class Level:
    """Return of the policy in one simulator, and its share of successes; None where nothing says what a success is."""

    episode_return: Interval
    success: float | None


@dataclass(frozen=True)
class Difference:
    """Return and share of successes that are lost; positive where the effect costs something."""

    episode_return: Interval
    success: Interval | None


@dataclass(frozen=True)
class EffectCost:
    """What one effect costs.

    Attributes:
        item: the effect.
        mended: what the policy gains where this effect alone is absent, and all others are there.
        alone: what it loses by this effect where no other is there.
    """

    item: Item
    mended: Difference
    alone: Difference


@dataclass(frozen=True)
class Other:
    """An explanation that the recordings cannot tell from the best: what all of it costs together."""

    items: tuple[Item, ...]
    repaired: Level
    total: Difference

    @property
    def label(self) -> str:
        """Its effects."""
        return " + ".join(item.label for item in self.items) or "no effect"


@dataclass(frozen=True)
class PolicyCost:
    """The answer.

    Attributes:
        episodes, draws: that were played in each simulator; one draw where no magnitude has an interval.
        nominal, repaired: without anything that the diagnosis names, and with all of it.
        total: what all of it costs together.
        effects: the costliest first.
        lead: by how much the first costs more than the second, as the intervals of both are not independent; None where
            there is but one.
        others: explanations that the recordings cannot tell from the one that is costed here.
    """

    episodes: int
    draws: int
    nominal: Level
    repaired: Level
    total: Difference
    effects: tuple[EffectCost, ...]
    lead: Interval | None
    others: tuple[Other, ...] = ()

    @property
    def first(self) -> EffectCost | None:
        """Which to mend first: the costliest, if its cost differs from 0; None where no single one's does."""
        costly = [one for one in self.effects if one.mended.episode_return.above_zero]
        return costly[0] if costly else None


def cost(
    make_env: Callable[[list[Entry]], gymnasium.Env[Any, Any]],
    policy: Any,
    diagnosis: Any,
    *,
    episodes: int = EPISODES,
    draws: int = DRAWS,
    seed: int = 0,
) -> PolicyCost:
    """The return that each effect of a diagnosis costs a policy, in an environment of anybody's.

    The policy is played in the nominal simulator, in that with everything that the diagnosis names, with each effect
    alone, and with all but each. The episodes have the same seeds everywhere, so that differences are paired.

    Args:
        make_env: makes the environment with these effects in it, none of them for the nominal one; its episodes end.
        policy: a function of the observation that returns the action; a model of stable-baselines3; or a
            :class:`~tiago_mj.rollout.episode.Policy`.
        diagnosis: as :func:`tiago_mj.policy_cost.magnitudes.items_of` takes it: the folder of a diagnosis, for one.
        episodes: in each simulator.
        draws: of magnitudes that have an interval; each is another simulator.
        seed: of the first episode, each later one adds 1; and of the draws.

    Raises:
        ValueError: nothing is named, or an argument is unusable; one line.
    """
    commander = as_policy(policy)

    def simulate(effects: Sequence[tuple[Entry, ...]]) -> list[list[Outcome]]:
        outcomes = []
        for one in effects:
            env = make_env(list(one))
            try:
                outcomes.append(play_all(env, commander, range(seed, seed + episodes)))
            finally:
                env.close()
        return outcomes

    for name, value in (("episodes", episodes), ("draws", draws)):
        if value < 1:
            raise ValueError(f"{name} is {value}: give 1 or more")
    items = items_of(diagnosis)
    return costs(Plan.of(items, draws, seed, others_of(result_of(diagnosis), items)), simulate)


@dataclass(frozen=True)
class Plan:
    """Which simulators are needed.

    Attributes:
        items: what is costed.
        drawn: the same with magnitudes drawn, once a draw.
        subsets: which items a simulator has, by their places; each once.
        others: further explanations, once a draw of their magnitudes.
    """

    items: tuple[Item, ...]
    drawn: tuple[tuple[Item, ...], ...]
    subsets: tuple[frozenset[int], ...]
    others: tuple[tuple[tuple[Item, ...], ...], ...] = ()

    @classmethod
    def of(cls, items: Sequence[Item], count: int, seed: int, others: Sequence[tuple[Item, ...]] = ()) -> Plan:
        """The plan for some items and for other explanations, with so many draws of their magnitudes."""
        whole = frozenset(range(len(items)))
        wanted = [frozenset[int](), whole]
        wanted += [part for i in whole for part in (frozenset({i}), whole - {i})]
        drawn = tuple(tuple(draws(other, count, seed)) for other in others)
        return cls(tuple(items), tuple(draws(items, count, seed)), tuple(dict.fromkeys(wanted)), drawn)

    def repeats(self, subset: frozenset[int]) -> int:
        """How many draws of a subset differ."""
        return len(self.drawn) if any(self.items[i].uncertain for i in subset) else 1

    @property
    def simulators(self) -> list[tuple[Entry, ...]]:
        """What each has beside the nominal model: all draws of the first subset, then of the second, and so on; then
        those of the other explanations."""
        own = [
            [self.drawn[draw][i] for i in sorted(subset)]
            for subset in self.subsets
            for draw in range(self.repeats(subset))
        ]
        others = [list(items) for drawn in self.others for items in drawn]
        return [tuple(entry for item in items for entry in item.entries) for items in (*own, *others)]


@dataclass(frozen=True)
class Played:
    """All episodes of one set of simulators: returns, and successes where they are known, (draws, episodes)."""

    returns: Array
    successes: Array | None

    @classmethod
    def of(cls, outcomes: Sequence[Sequence[Outcome]], count: int) -> Played:
        """From a row of outcomes a draw; one row stands for each of ``count`` draws."""
        said = [[one.success for one in row] for row in outcomes]
        known = all(one is not None for row in said for one in row)
        returns = _spread([[one.episode_return for one in row] for row in outcomes], count)
        return cls(returns, _spread(said, count) if known else None)

    def less(self, other: Played) -> Difference:
        """What these episodes have more than another set's."""
        won, lost = self.successes, other.successes
        success = None if won is None or lost is None else of_successes(won, lost)
        return Difference(of_returns(self.returns - other.returns), success)

    def first(self, count: int) -> Played:
        """The first draw's, for each of so many draws."""
        successes = None if self.successes is None else _spread(self.successes[:1], count)
        return Played(_spread(self.returns[:1], count), successes)

    @property
    def level(self) -> Level:
        """Their mean."""
        return Level(of_returns(self.returns), None if self.successes is None else float(self.successes.mean()))


def costs(plan: Plan, simulate: Simulate) -> PolicyCost:
    """Play in all simulators of a plan, and compare.

    Raises:
        ValueError: as ``simulate`` does.
    """
    outcomes, count = iter(simulate(plan.simulators)), len(plan.drawn)
    played = {one: Played.of([next(outcomes) for _ in range(plan.repeats(one))], count) for one in plan.subsets}
    none, whole = plan.subsets[0], frozenset(range(len(plan.items)))
    nominal, repaired = played[none], played[whole]
    found = [
        EffectCost(item, played[whole - {i}].less(repaired), nominal.less(played[frozenset({i})]))
        for i, item in enumerate(plan.items)
    ]
    order = sorted(range(len(found)), key=lambda i: -found[i].mended.episode_return.mean)
    without = [played[whole - {i}].returns for i in order[:2]]
    others = []
    for drawn in plan.others:
        other = Played.of([next(outcomes) for _ in drawn], len(drawn))
        others.append(Other(drawn[0], other.level, nominal.first(len(drawn)).less(other)))
    return PolicyCost(
        episodes=nominal.returns.shape[1],
        draws=count,
        nominal=nominal.level,
        repaired=repaired.level,
        total=nominal.less(repaired),
        effects=tuple(found[i] for i in order),
        lead=of_returns(without[0] - without[1]) if len(without) > 1 else None,
        others=tuple(others),
    )


def _spread(rows: Any, count: int) -> Array:
    """(draws, episodes); what does not depend on the draw stands in each."""
    values = np.array(rows, dtype=np.float64)
    return np.broadcast_to(values, (count, values.shape[1])) if len(values) == 1 else values
