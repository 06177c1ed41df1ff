"""What effects cost a policy: known answers, pairing, and whatever acts."""

import numpy as np
import pytest
from toy import BACKLASH, BIAS, PAYLOAD, Toy, follows, knows

from tiago_mj.policy_cost import cost
from tiago_mj.policy_cost.effect_costs import Plan
from tiago_mj.policy_cost.magnitudes import items_of
from tiago_mj.policy_cost.play import LoggedActions
from tiago_mj.policy_cost.report import answer, as_data, text


def by_name(found):
    return {one.item.name: one for one in found.effects}


def test_an_effect_that_hurts_comes_before_one_that_does_not_with_the_cost_that_it_has():
    found = cost(Toy, knows, [BACKLASH, PAYLOAD], episodes=6, draws=20)
    assert [one.item.name for one in found.effects] == ["payload", "backlash"]
    hurts, harmless = found.effects
    # Ten steps of 2 kg; the interval is that of the magnitude: 95 % of a normal distribution of which 90 % are ±1.
    cost_of = hurts.mended.episode_return
    assert cost_of.mean == pytest.approx(20.0, abs=0.1)
    assert cost_of.low == pytest.approx(20 - 1.96 / 1.645, abs=0.4)
    assert cost_of.high == pytest.approx(20 + 1.96 / 1.645, abs=0.4)
    assert hurts.alone == hurts.mended
    assert harmless.mended.episode_return.mean == 0
    assert (harmless.mended.episode_return.low, harmless.mended.episode_return.high) == (0, 0)
    assert found.first is hurts
    assert found.lead.above_zero
    assert answer(found).startswith("Mend payload first: without it the return is higher by 20")
    assert "No cost that differs from 0: backlash" in answer(found)


def test_what_costs_one_policy_costs_another_nothing_and_that_is_said():
    looks, blind = (cost(Toy, policy, [BIAS], episodes=5) for policy in (follows, knows))
    assert looks.first.item.name == "encoder_bias"
    assert looks.first.mended.episode_return.mean == pytest.approx(1.0, abs=0.05)  # ten steps of 0.1
    assert blind.first is None
    assert answer(blind) == "No effect's cost differs from 0: for this policy there is nothing to mend first."


def test_differences_are_of_the_same_episodes_so_that_their_difficulty_cancels():
    made = []

    def make_env(effects):
        made.append(Toy(effects))
        return made[-1]

    fixed = {"name": "payload", "parameters": {"mass": 2.0}}
    found = cost(make_env, knows, [fixed], episodes=8, seed=3)
    assert [env.seeds for env in made] == [list(range(3, 11))] * 2  # nominal and repaired: with one effect no more
    assert found.draws == 1
    # Returns scatter by the drawn difficulty; their paired difference does not at all.
    assert found.nominal.episode_return.high - found.nominal.episode_return.low > 10
    paired = found.total.episode_return
    assert paired.mean == pytest.approx(20.0)
    assert paired.high - paired.low < 1e-9


def test_success_is_told_as_the_share_that_is_lost_and_is_never_certain():
    found = cost(Toy, knows, [BACKLASH, PAYLOAD], episodes=20)
    lost = by_name(found)["payload"].mended.success
    assert lost.mean == pytest.approx(found.nominal.success - found.repaired.success)
    assert lost.mean > 0.2
    nothing = by_name(found)["backlash"].mended.success
    assert nothing.mean == 0
    assert nothing.low < 0 < nothing.high  # 20 pairs that agree do not prove that none would differ


def test_effects_of_which_each_alone_does_all_the_harm_are_told_as_that():
    class Either(Toy):
        def step(self, action):
            seen, reward, *rest = super().step(action)
            return seen, reward - 5.0 * bool(self.effects), *rest

    effects = [{"name": "backlash", "parameters": {"width": 0.01}}, {"name": "force_lag", "parameters": {}}]
    found = cost(Either, knows, effects, episodes=5)
    assert found.first is None
    assert "Together they cost 50" in answer(found)
    assert "mending no single one brings return back" in answer(found)


def test_an_effect_that_helps_is_said_to():
    class Helped(Toy):
        def step(self, action):
            seen, reward, *rest = super().step(action)
            return seen, reward + 2 * self.amount("payload", "mass"), *rest

    found = cost(Helped, knows, [PAYLOAD], episodes=5)
    assert found.first is None
    assert "The return is higher with payload" in answer(found)


def test_one_episode_tells_no_interval_and_says_so():
    found = cost(Toy, knows, [PAYLOAD], episodes=1)
    assert found.total.episode_return.low is None
    assert "give more episodes" in answer(found)


def test_a_model_with_predict_and_a_policy_that_takes_info_act_as_a_function_does():
    class Model:
        def predict(self, observation, deterministic=False):
            assert deterministic
            return np.array([1.0]), None

    class Stateful:
        begun = 0

        def reset(self):
            self.begun += 1

        def __call__(self, observation, info):
            assert isinstance(info, dict)
            return np.array([1.0])

    class Recurrent:
        begun = 0

        def reset(self):
            self.begun += 1

        def __call__(self, observation):
            return np.array([1.0])

    wanted = cost(Toy, knows, [PAYLOAD], episodes=3, draws=2)
    stateful, recurrent = Stateful(), Recurrent()
    for policy in (Model(), stateful, recurrent):
        assert cost(Toy, policy, [PAYLOAD], episodes=3, draws=2) == wanted
    assert stateful.begun == recurrent.begun == 9  # three episodes in the nominal simulator and in each of two draws


def test_logged_actions_are_sent_again_in_every_simulator():
    sent = []

    class Listens(Toy):
        def step(self, action):
            sent.append(float(action[0]))
            return super().step(action)

    actions = [np.full((10, 1), 1.0), np.full((4, 1), 2.0)]
    found = cost(Listens, LoggedActions(actions), [PAYLOAD], episodes=2, draws=3)
    assert found.first.item.name == "payload"
    assert sent == ([1.0] * 10 + [2.0] * 10) * 4
    with pytest.raises(ValueError, match="one action or more"):
        LoggedActions([[]])


def test_every_simulator_is_made_once():
    plan = Plan.of(items_of([PAYLOAD, BACKLASH, {"name": "force_lag", "parameters": {}}]), 4, 0)
    # Of three: none, all, each alone, all but each. The draws of a simulator without an interval are one.
    assert len(plan.subsets) == 8
    assert plan.repeats(frozenset({2})) == 1
    assert plan.repeats(frozenset({0, 2})) == 4
    assert len(plan.simulators) == 1 + 4 + 4 + 4 + 1 + 4 + 4 + 4
    assert Plan.of(items_of([PAYLOAD]), 4, 0).subsets == (frozenset(), frozenset({0}))


@pytest.mark.parametrize(
    ("given", "options", "said"),
    [
        ([], {}, "names no effect"),
        ({"schema": "tiago_mj.calibration/1", "effects": []}, {}, "names no effect"),
        (7, {}, "the diagnosis is int"),
        ([{"name": "no_such"}], {}, "is unknown"),
        ([PAYLOAD, PAYLOAD], {}, "payload is named 2 times"),
        ([{"name": "payload", "parameters": {"mass": {"value": 2.0, "low": 3.0, "high": 4.0}}}], {}, "holds the value"),
        ([PAYLOAD], {"episodes": 0}, "episodes is 0"),
        ([PAYLOAD], {"draws": 0}, "draws is 0"),
        ("no/such/folder", {}, "no diagnosis at"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_line(given, options, said):
    with pytest.raises(ValueError, match=said) as fault:
        cost(Toy, knows, given, **options)
    assert "\n" not in str(fault.value)


def test_what_does_not_act_and_an_episode_without_end_are_refused(monkeypatch):
    with pytest.raises(ValueError, match="policy is int: give a callable"):
        cost(Toy, 3, [PAYLOAD])

    class Endless(Toy):
        def step(self, action):
            self.left = 5
            return super().step(action)

    monkeypatch.setattr("tiago_mj.policy_cost.play.MOST_STEPS", 50)
    with pytest.raises(ValueError, match="has not ended after 50 steps"):
        cost(Endless, knows, [PAYLOAD])


def test_report_and_data_say_the_same():
    found = cost(Toy, knows, [PAYLOAD, BACKLASH], episodes=5)
    said, data = text(found, "policy knows in Toy", ["A note."]), as_data(found, {"env": "Toy"}, ["A note."])
    assert data["mend_first"] == "payload"
    assert data["answer"] in said
    assert "A note." in said
    assert data["effects"][0]["mended"]["episode_return"]["mean"] == found.effects[0].mended.episode_return.mean
    assert [row.split()[0] for row in said.splitlines() if row.startswith(("payload", "backlash"))] == [
        "payload",
        "backlash",
    ]
