"""Runs whose commands are known beforehand are made in one go."""

from __future__ import annotations

import numpy as np
import pytest

from tiago_mj.effects.runner import Runner
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.record.environment import Plan, record
from tiago_mj.rollout.policies import make_policy

MIXED = (
    (),
    (Entry("viscous_friction", None, {"damping": 30.0}), Entry("command_delay", None, {"seconds": 0.011})),
    (Entry("command_lag", None, {"time_constant": 0.02}), Entry("encoder_bias", None, {"offset": 1e-4})),
    (Entry("stribeck_friction", None, {"static": 2.0, "velocity": 0.01}),),
    (Entry("contact_stiffness", None, {"factor": 0.5}), Entry("force_gain", None, {"factor": 1.2})),
    (Entry("object_mass", None, {"factor": 2.0}),),
    (Entry("clock_skew", None, {"rate": 0.01}),),
)


@pytest.mark.parametrize(("control", "policy"), [("velocity", "pi"), ("position", "random")])
def test_a_run_in_one_go_is_that_of_single_steps_to_the_last_bit(
    control: str, policy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = Plan("tiago_mj/GripperTactile-v0", {"control": control}, None, None, policy)
    trials = list(record(plan, lambda env: make_policy(policy, env, seed=0, trust=False), episodes=2, seed=0))
    plant = plant_of(trials)
    on = replay.grid(plant, trials)
    sims = [(k % 2, effects) for k, effects in enumerate(MIXED)]
    at_once: list[bool] = []
    known = Runner.open_loop.fget
    assert known is not None
    monkeypatch.setattr(Runner, "open_loop", property(lambda runner: at_once.append(known(runner)) or at_once[-1]))
    in_one_go = replay.simulate(plant, on, sims, replay.Run(threads=1))
    assert sorted(at_once) == [False, True]
    monkeypatch.setattr(replay, "_in_batches", replay._batch)
    monkeypatch.setattr(Runner, "open_loop", False)
    stepwise = replay.simulate(plant, on, sims, replay.Run(threads=1))
    for name in replay.Signals.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(in_one_go, name), getattr(stepwise, name), err_msg=name)
