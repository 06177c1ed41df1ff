"""Effects on the commands of a plain position servo, whose set point jumps with every command."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from tiago_mj.effects.host import ScalarHost
from tiago_mj.effects.runner import Runner
from tiago_mj.effects.spec import Entry
from tiago_mj.effects.wiring import wire

PENDULUM = """
<mujoco><option timestep="0.001" integrator="implicitfast"/><worldbody><body>
<joint name="hinge" axis="0 1 0" damping=".05"/>
<geom type="capsule" size=".01" fromto="0 0 0 0 0 -.2" mass=".5"/></body></worldbody>
<actuator><position name="hinge" joint="hinge" kp="20" kv="0.6"/></actuator></mujoco>
"""
PERIOD = 0.04
COMMANDS = np.repeat([0.0, 0.4, -0.2, 0.1, 0.5, 0.5, 0.0], 4)


def play(effects: tuple[Entry, ...], commands: np.ndarray, period: float) -> np.ndarray:
    """Joint position after every control period [rad]."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    wiring = wire(model, joints=["hinge"], actuators=["hinge"], interface="position")
    runner = Runner(ScalarHost(data), wiring, [effects], lambda shape: np.zeros(shape))
    runner.start(period, round(period / model.opt.timestep))
    out = []
    for command in commands:
        runner.advance(np.array([[command]]))
        out.append(data.qpos[0])
    return np.array(out)


def finely(commands: np.ndarray, every: int) -> np.ndarray:
    return np.repeat(commands, every)


@pytest.mark.parametrize("periods", [0.4, 1.0, 1.75])
def test_a_delay_switches_the_set_point_within_the_period(periods):
    """The same as sending it later on a grid of 2 ms: no ramp between two commands."""
    late = play((Entry("command_delay", None, {"seconds": periods * PERIOD}),), COMMANDS, PERIOD)
    shift = round(periods * 20)
    fine = finely(COMMANDS, 20)
    sent_later = np.concatenate([np.zeros(shift), fine])[: len(fine)]
    np.testing.assert_allclose(late, play((), sent_later, PERIOD / 20)[19::20], atol=1e-12)


@pytest.mark.parametrize(
    "effect", [Entry("command_lag", None, {"time_constant": 0.03}), Entry("rate_limit", None, {"velocity": 4.0})]
)
def test_lag_and_rate_limit_do_not_depend_on_the_rate_of_the_commands(effect):
    """Held commands are the same command at any rate; what remains is the lag's share of one 1 ms step."""
    coarse = play((effect,), COMMANDS, PERIOD)
    fine = play((effect,), finely(COMMANDS, 10), PERIOD / 10)[9::10]
    np.testing.assert_allclose(coarse, fine, atol=1e-9)
    assert np.abs(coarse - play((), COMMANDS, PERIOD)).max() > 0.01
