"""One runner steps one simulation and many, command by command and in one go."""

from __future__ import annotations

import mujoco
import mujoco.batch
import numpy as np
import pytest

from tiago_mj.effects import Entry
from tiago_mj.effects.host import BatchHost, ScalarHost
from tiago_mj.effects.runner import LoadCells, Log, Runner
from tiago_mj.effects.wiring import wire

PENDULUM = """
<mujoco><option timestep="0.001" integrator="implicitfast"/><worldbody><body>
<joint name="hinge" axis="0 1 0" damping=".05"/>
<geom type="capsule" size=".01" fromto="0 0 0 0 0 -.2" mass=".5"/></body></worldbody>
<actuator><position name="hinge" joint="hinge" kp="20" kv="0.6"/></actuator></mujoco>
"""
PERIOD, SUBSTEPS = 0.02, 20
COMMANDS = np.repeat([0.0, 0.4, -0.2, 0.1, 0.5, 0.0], 9)[:, None]
EFFECTS = {
    "nothing": (),
    "of the signal": (Entry("command_delay", None, {"seconds": 0.013}), Entry("encoder_bias", None, {"offset": 0.01})),
    "of the model": (Entry("viscous_friction", None, {"damping": 0.1}), Entry("payload", None, {"mass": 0.2})),
    "in every physics step": (Entry("stribeck_friction", None, {"static": 0.1, "velocity": 0.01}),),
}


TWO_LINKS = """
<mujoco><option timestep="0.001" integrator="implicitfast"/><worldbody><body>
<joint name="shoulder" axis="0 1 0"/><geom type="capsule" size=".01" fromto="0 0 0 0 0 -.3" mass=".5"/>
<body pos="0 0 -.3"><joint name="elbow" axis="0 1 0"/>
<geom type="capsule" size=".01" fromto="0 0 0 0 0 -.2" mass=".5"/></body></body></worldbody>
<actuator><position name="shoulder" joint="shoulder" kp="60" kv="4"/>
<position name="elbow" joint="elbow" kp="30" kv="2"/></actuator></mujoco>
"""


def model_and_wiring():
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    return model, wire(model, joints=["hinge"], actuators=["hinge"], interface="position")


def played(host, wiring, effects, commands=COMMANDS, parts=1):
    runner = Runner(host, wiring, [effects] * host.nsim, np.zeros)
    runner.start(PERIOD, SUBSTEPS)
    runner.seen()
    host.forward()
    log = Log(runner, LoadCells(lambda sensordata: sensordata[..., :0]), len(commands) * parts + 1, poses=True)
    runner.run(np.repeat(commands[None], host.nsim, axis=0), log, parts=parts)
    return runner, log


def batch(nsim):
    model, wiring = model_and_wiring()
    host = BatchHost(mujoco.batch.Batch(model, nsim, 1))
    host.batch.reset()
    return host, wiring


@pytest.mark.parametrize("which", EFFECTS)
def test_a_batch_runs_as_one_simulation_does_to_the_last_bit(which):
    model, wiring = model_and_wiring()
    _, alone = played(ScalarHost(mujoco.MjData(model)), wiring, EFFECTS[which])
    runner, many = played(*batch(3), EFFECTS[which])
    assert runner.open_loop == (which != "in every physics step")
    for one, all_of_them in zip(alone.readings, many.readings, strict=True):
        for row in all_of_them:
            np.testing.assert_array_equal(row, one[0])
    assert np.ptp(alone.readings.position) > 0.3
    bias = 0.01 if which == "of the signal" else 0.0
    np.testing.assert_array_equal(alone.poses[0, :, 0] + bias, alone.readings.position[0, :, 0])


@pytest.mark.parametrize("which", ["nothing", "of the signal", "in every physics step"])
def test_samples_between_rows_leave_the_rows_as_they_are(which):
    _, rows = played(*batch(1), EFFECTS[which])
    _, parts = played(*batch(1), EFFECTS[which], parts=4)
    np.testing.assert_array_equal(parts.readings.velocity[:, ::4], rows.readings.velocity)
    assert (np.diff(parts.readings.position[0, :, 0]) != 0).sum() > 3 * len(COMMANDS)


def test_what_diverges_ends_and_says_when():
    model, wiring = model_and_wiring()
    commands = COMMANDS.copy()
    commands[10] = 1e13
    runner, log = played(ScalarHost(mujoco.MjData(model)), wiring, (), commands)
    assert log.ends.tolist() == [11]  # the start and what is seen after each of the ten commands before
    assert runner.host.diverged.all()
    assert np.isnan(log.poses[0, 12:]).all()
    assert np.isfinite(log.poses[0, :11]).all()


def test_a_simulation_of_a_batch_has_the_inertia_of_its_own_pose_and_masses():
    model = mujoco.MjModel.from_xml_string(TWO_LINKS)
    joints = ["shoulder", "elbow"]
    limit, payload = Entry("velocity_limit", None, {"velocity": 0.5}), Entry("payload", None, {"mass": 0.3})
    sims, poses = [(limit,), (limit, payload), (limit,)], np.array([[0.0, 0.0], [0.2, 1.0], [0.2, 2.0]])
    commands = np.repeat(poses[:, None], 40, axis=1) + np.linspace(0, 1.5, 40)[:, None]

    def speeds(host, sims, poses, commands):
        host.state("qpos")[:] = poses
        runner = Runner(host, wire(host.model, joints=joints, actuators=joints, interface="position"), sims, np.zeros)
        runner.start(PERIOD, SUBSTEPS)
        host.forward()
        log = Log(runner, LoadCells(lambda sensordata: sensordata[..., :0]), commands.shape[1] + 1)
        runner.run(commands, log)
        return log.readings.velocity

    together = speeds(BatchHost(mujoco.batch.Batch(model, 3, 1)), sims, poses, commands)
    for k in range(3):
        own = mujoco.MjModel.from_xml_string(TWO_LINKS)
        alone = speeds(ScalarHost(mujoco.MjData(own)), sims[k : k + 1], poses[k : k + 1], commands[k : k + 1])
        np.testing.assert_array_equal(together[k], alone[0])
