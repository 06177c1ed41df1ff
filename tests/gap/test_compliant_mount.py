"""A base that gives way, of a robot whose base stands on MuJoCo's own hinges: read off its swing, met, and found."""

from __future__ import annotations

import json

import mujoco
import numpy as np
import pytest

from tiago_mj.effects import Entry
from tiago_mj.effects.mount import MOUNT_DAMPING
from tiago_mj.gap.detectors import swings
from tiago_mj.gap.inference.hypotheses import candidates
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.read import read_recordings

JOINTS = ("lift", "bend")
STEP, ROW = 0.002, 0.02  # s
STIFFNESS, INERTIA, NOISE = 1500.0, 1.0, 1e-4  # N·m/rad, kg·m², rad


def arm(base='<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'):
    servos = zip(JOINTS, (500, 200), (25, 8), strict=True)
    actuators = "".join(f'<position name="{name}" joint="{name}" kp="{kp}" kv="{kv}"/>' for name, kp, kv in servos)
    return f"""<mujoco>
      <option timestep="{STEP}" integrator="implicitfast"/>
      <worldbody><body>{base}
        <body pos="0 0 .3"><joint name="lift" axis="0 1 0" armature=".05" damping=".5"/>
          <geom type="capsule" fromto="0 0 0 .3 0 0" size=".04" mass="2"/>
          <body pos=".3 0 0"><joint name="bend" axis="1 0 0" armature=".02" damping=".2"/>
            <geom type="capsule" fromto="0 0 0 .05 .25 0" size=".03" mass="1.5"/>
          </body>
        </body>
      </body></worldbody>
      <actuator>{actuators}</actuator>
    </mujoco>"""


def on_hinges(inertia, damping):
    springs = f'stiffness="{STIFFNESS}" damping="{damping}"'
    hinges = f'<joint axis="1 0 0" {springs}/><joint axis="0 1 0" {springs}/>'
    return arm(f'{hinges}<inertial pos="0 0 0" mass="1" diaginertia="{inertia} {inertia} {inertia}"/>')


def own_inertia():
    """Of the robot about its foot, the mean of both axes [kg·m²]."""
    model = mujoco.MjModel.from_xml_string(on_hinges(1e-6, 0))
    data, matrix = mujoco.MjData(model), np.zeros((4, 4))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, matrix)
    return (matrix[0, 0] + matrix[1, 1]) / 2


WHOLE = INERTIA + own_inertia()
FREQUENCY = np.sqrt(STIFFNESS / WHOLE) / (2 * np.pi)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three recordings of jumps about both joints, and the model with a base that stands fast."""
    out = tmp_path_factory.mktemp("mounted")
    model = mujoco.MjModel.from_xml_string(on_hinges(INERTIA, 2 * MOUNT_DAMPING * np.sqrt(STIFFNESS * WHOLE)))
    rng = np.random.default_rng(0)
    for k in range(3):
        data, rows = mujoco.MjData(model), []
        goals = np.repeat(rng.uniform(-0.3, 0.3, (3, 2)), 25, axis=0)
        data.ctrl[:] = goals[0]
        mujoco.mj_step(model, data, round(8 / STEP))  # at rest
        start = data.qpos[2:].copy()
        for row, goal in enumerate(goals):
            rows.append((ROW * row, *goal, *(data.qpos[2:] + rng.normal(0, NOISE, 2))))
            data.ctrl[:] = goal
            mujoco.mj_step(model, data, round(ROW / STEP))
        lines = "\n".join(",".join(f"{value:.9g}" for value in row) for row in rows)
        header = ",".join(("time", *(f"{kind}.{name}" for kind in ("command", "position") for name in JOINTS)))
        (out / f"t{k}.csv").write_text(f"{header}\n{lines}\n")
        at = {"position": dict(zip(JOINTS, start.tolist(), strict=True))}
        at["set_point"] = dict(zip(JOINTS, goals[0].tolist(), strict=True))
        facts = {"robot": "robot.xml", "interface": "position", "rate_hz": 1 / ROW, "initial": at}
        (out / f"t{k}.json").write_text(json.dumps(facts))
    (out / "robot.xml").write_text(arm())
    return out


@pytest.fixture(scope="module")
def replays(folder):
    """Errors of a replay with some effects, (ntrials, T, njoints) [rad], the plant, and the pool of candidates."""
    trials = read_recordings([folder]).trials
    plant = plant_of(trials, model=folder / "robot.xml")
    read = np.array([[trial.positions[name] for name in JOINTS] for trial in trials]).transpose(0, 2, 1)

    def error(*entries):
        sims = [(k, entries) for k in range(len(trials))]
        predicted = replay.simulate(plant, replay.grid(plant, trials), sims, replay.Run(threads=1)).position
        return predicted[:, : read.shape[1]] - read

    return error, plant


def measured(value):
    channels, shape = tuple(f"position.{name}" for name in JOINTS), value.shape
    return Data(channels, np.arange(2), value, np.full(2, NOISE), np.full(shape, NOISE), np.zeros(shape))


def rms(error):
    return float(np.sqrt(np.square(error).mean()))


def test_at_the_truth_a_replay_leaves_little_more_than_noise(replays):
    error, _ = replays
    numbers = {"compliance": 1 / STIFFNESS, "frequency": FREQUENCY}
    gap, left = rms(error()), rms(error(Entry("compliant_mount", None, numbers)))
    assert gap > 10 * NOISE
    assert left < 1.5 * NOISE


def test_the_frequency_is_read_off_the_errors_of_all_joints(replays):
    error, _ = replays
    value = -error()
    data = measured(value)
    first, *_ = swings.peaks(data, np.zeros(value.shape), ROW, 1.0, 40.0)
    assert first == pytest.approx(FREQUENCY, rel=1.5 * swings.WIDTH)


def test_a_mount_is_sought_at_what_swings_and_all_else_as_it_was(replays):
    error, plant = replays
    value = -error()
    data = measured(value)
    pool = candidates(plant, ["compliant_mount", "payload"])
    proposed = swings.with_frequencies(data, np.zeros(value.shape), ROW, pool)
    mounts = [one for one in proposed if one.effect == "compliant_mount"]
    assert 1 <= len(mounts) <= swings.MAX_FREQUENCIES
    assert [one for one in proposed if one.effect != "compliant_mount"] == [c for c in pool if c.effect == "payload"]


@pytest.mark.slow
def test_a_mount_is_found_with_how_far_it_gives_and_how_fast_it_rocks(folder):
    names = ("compliant_mount", "viscous_friction", "servo_stiffness")
    found = diagnose(read_recordings([folder]).trials, model=folder / "robot.xml", names=names, threads=0)
    assert found.kind == "effect"
    (effect,) = found.best.effects
    assert effect.name == "compliant_mount"
    compliance = effect.parameters["compliance"]
    assert compliance.low < 1 / STIFFNESS < compliance.high
    assert effect.parameters["frequency"].value == pytest.approx(FREQUENCY, rel=0.05)
    assert found.shrink.closed > 0.9
