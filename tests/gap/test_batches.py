"""Explanations are simulated side by side: what stands beside one in a batch is no part of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.declare import is_random
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference import hypotheses
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import Plant, plant_of
from tiago_mj.recordings.record.environment import Plan, record
from tiago_mj.recordings.recording import Sidecar, Trial
from tiago_mj.rollout.policies import make_policy

PENDULUM = """
<mujoco model="pendulum"><option timestep="0.002" integrator="implicitfast"/><worldbody><body>
<joint name="hinge" axis="0 1 0" damping=".05" range="-2 2" limited="true"/>
<geom type="capsule" size=".01" fromto="0 0 0 0 0 -.2" mass=".5"/></body></worldbody>
<actuator><position name="hinge" joint="hinge" kp="20" kv="0.6" forcerange="-4 4"/></actuator></mujoco>
"""


def hinge(folder: Path, rate: float) -> list[Trial]:
    model = folder / "pendulum.xml"
    model.write_text(PENDULUM)
    time = np.arange(round(0.5 * rate)) / rate
    command = 0.4 * np.sin(2 * np.pi * 1.5 * time)
    sidecar = Sidecar(trial="swing", robot=str(model), rate_hz=rate, interface="position")
    still = {"hinge": np.zeros_like(time)}
    return [Trial("swing", time, {"hinge": command}, still, still, {}, {}, sidecar, "swing.csv")]


def grasp() -> list[Trial]:
    plan = Plan("tiago_mj/GripperTactile-v0", {}, None, None, "pi")
    return list(record(plan, lambda env: make_policy("pi", env, seed=0, trust=False), episodes=1, seed=0))


def every_effect(plant: Plant) -> list[tuple[int, tuple[Entry, ...]]]:
    """Each at the second largest magnitude that is tried; but for those that draw, whose draws depend on the batch."""
    first = {candidate.effect: candidate for candidate in reversed(hypotheses.candidates(plant))}
    first = {name: candidate for name, candidate in first.items() if not is_random(EFFECTS[name])}
    return [(0, ()), *((0, (candidate.entry(candidate.grid[-2]),)) for candidate in first.values())]


@pytest.mark.parametrize("plant_at", ["hinge 240", "hinge 25", "gripper"])
def test_an_effect_beside_all_others_does_what_it_does_alone(plant_at, tmp_path):
    """At 240 Hz a period is no whole number of the model's 2 ms: steps are shorter then, whoever's clock is wrong."""
    trials = grasp() if plant_at == "gripper" else hinge(tmp_path, float(plant_at.split()[1]))
    plant = plant_of(trials)
    on = replay.grid(plant, trials)
    sims = every_effect(plant)
    assert len(sims) > 0.4 * len(EFFECTS)
    together = replay.simulate(plant, on, sims, replay.Run(threads=2))
    for k, one in enumerate(sims):
        alone = replay.simulate(plant, on, [one], replay.Run(threads=1))
        for name in ("position", "velocity", "reading"):
            beside = getattr(together, name)[k]
            np.testing.assert_allclose(beside, getattr(alone, name)[0], rtol=0, atol=1e-12, err_msg=f"{one[1]} {name}")
