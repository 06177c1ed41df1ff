"""Parts that are built alike: which magnitudes agree, which part differs, and what is compared one by one."""

from __future__ import annotations

import json

import mujoco
import numpy as np
import pytest

from tiago_mj.cli import main
from tiago_mj.effects.targets import Targets
from tiago_mj.gap.ahead import Ahead
from tiago_mj.gap.analysis.likeness import compared, mean
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.parts import Likeness, Value
from tiago_mj.gap.pipeline import beside_nominal
from tiago_mj.gap.report.like_parts import sentence
from tiago_mj.gap.request import Request, SoFar
from tiago_mj.gap.search import shared
from tiago_mj.gap.simulation.session import session as session_of
from tiago_mj.gap.torque.by_part import apart, of_joints
from tiago_mj.recordings.like import alike
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import RecordingError

LEGS = ("FL", "FR", "RL", "RR")
KP, KV = 20.0, 0.5


def robot(friction=(0.0, 0.0, 0.0, 0.0)):
    """MJCF of four legs with a hip and a knee below a floating base; the knees rub."""
    legs = "".join(
        f'<body pos="{k} 0 0"><joint name="{leg}_hip_joint" axis="0 1 0" armature="0.01" damping="0.1"/>'
        '<geom type="capsule" size=".02" fromto="0 0 0 0 0 -.2" mass="1" contype="0" conaffinity="0"/>'
        f'<body pos="0 0 -.2"><joint name="{leg}_knee_joint" axis="0 1 0" armature="0.01" damping="0.1" '
        f'frictionloss="{rub}"/><geom type="capsule" size=".015" fromto="0 0 0 0 0 -.2" mass=".4" contype="0" '
        'conaffinity="0"/></body></body>'
        for k, (leg, rub) in enumerate(zip(LEGS, friction, strict=True))
    )
    motors = "".join(
        f'<motor name="{leg}_{part}" joint="{leg}_{part}_joint"/>' for leg in LEGS for part in ("hip", "knee")
    )
    return (
        '<mujoco><option timestep="0.001" integrator="implicitfast"/><worldbody><body name="base" pos="0 0 1">'
        f'<freejoint/><geom size=".1" mass="5"/>{legs}</body></worldbody><actuator>{motors}</actuator></mujoco>'
    )


def recorded(folder, friction, seconds=24.0):
    """Goals and positions of the legs in the air at 200 Hz, each joint at periods of its own, and the model."""
    model = mujoco.MjModel.from_xml_string(robot(friction).replace("<freejoint/>", ""))
    data, rng, rows = mujoco.MjData(model), np.random.default_rng(0), []
    names = [model.joint(j).name for j in range(model.njnt)]
    for at in np.arange(0, seconds, 0.005):
        goal = np.array([0.5 * np.sin(2 * np.pi * at / (1.3 + 0.11 * k)) for k in range(model.nq)])
        rows.append([at, *goal, *(data.qpos + rng.normal(0, 2e-5, model.nq))])
        for _ in range(5):
            data.ctrl[:] = KP * (goal - data.qpos) - KV * data.qvel
            mujoco.mj_step(model, data)
    header = ["time", *(f"command.{name}" for name in names), *(f"position.{name}" for name in names)]
    np.savetxt(folder / "log.csv", rows, delimiter=",", header=",".join(header), comments="", fmt="%.8g")
    (folder / "robot.xml").write_text(robot())
    facts = {"robot": "robot.xml", "interface": "position", "gains": f"{KP},{KV}", "base": "fixed", "like": LEGS}
    (folder / "log.json").write_text(json.dumps(facts))
    return folder / "log.csv"


def test_magnitudes_that_agree_and_the_part_that_differs():
    alike_ones = {"FL": (1.0, 0.1), "FR": (1.1, 0.1), "RL": (0.9, 0.1), "RR": (1.05, 0.1)}
    chi_square, chance, differs = compared(alike_ones, 0.05)
    assert chi_square == pytest.approx(((0.0125) ** 2 + 0.0875**2 + 0.1125**2 + 0.0375**2) / 0.01)
    assert chance > 0.5
    assert differs == ()
    assert compared({**alike_ones, "RL": (2.0, 0.1)}, 0.05)[2] == ("RL",)
    assert compared({"L": (1.0, 0.1), "R": (2.0, 0.1)}, 0.05)[2] == ("L", "R")
    assert compared({"A": (1.0, 0.1), "B": (3.0, 0.1), "C": (5.0, 0.1)}, 0.05)[2] == ("A", "B", "C")
    assert mean([(1.0, 0.1), (2.0, 0.2)]) == pytest.approx((1.2, 0.1 / 1.25**0.5))


def test_parts_that_are_alike_are_rarely_said_to_differ():
    rng = np.random.default_rng(3)
    told = [
        compared(dict(zip(LEGS, [(float(v), 0.1) for v in rng.normal(1, 0.1, 4)], strict=True)), 0.05)[2]
        for _ in range(400)
    ]
    assert 4 <= sum(bool(one) for one in told) <= 36  # 20 are expected


def test_names_of_like_parts_and_what_is_refused():
    names = ("FL_hip", "FL_knee", "FR_hip", "FR_knee", "base")
    assert alike(names, ("FL", "FR"))["FR"] == {"hip": "FR_hip", "knee": "FR_knee"}
    for said, why in ((("FL",), "two parts"), (("FL", "XX"), "begins with XX"), (("FL", "ba"), "the same joints")):
        with pytest.raises(RecordingError, match=rf"^like is {', '.join(said)}: .*{why}"):
            alike(names, said)


def test_legs_move_each_other_by_nothing_and_an_arm_on_a_leg_does():
    model = mujoco.MjModel.from_xml_string(robot())
    legs = alike([model.joint(j).name for j in range(model.njnt)], LEGS)
    assert apart(model, legs)
    chain = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint name="A_x"/><geom size="1"/><body><joint name="B_x"/><geom size="1"/></body>'
        "</body></worldbody></mujoco>"
    )
    assert not apart(chain, alike(("A_x", "B_x"), ("A", "B")))


@pytest.mark.slow
def test_torques_of_a_leg_alone_are_those_of_the_whole(tmp_path):
    trials = read_recordings([recorded(tmp_path, (0, 0, 0, 0), seconds=8.0)]).trials
    whole = beside_nominal(session_of(trials), Request(), SoFar(Ahead(lambda stage, done, left: None))).predict
    joints = ("RL_hip_joint", "RL_knee_joint")
    leg = of_joints(whole, joints)
    columns = [whole.data.channels.index(f"effort.{joint}") for joint in joints]
    trials = range(len(whole.data.value))
    assert leg.all_trials([()], trials) == pytest.approx(whole.all_trials([()], trials)[..., columns], abs=1e-9)
    assert leg.plant.wiring.targets.joint == joints
    assert np.array_equal(leg.data.value, whole.data.value[..., columns], equal_nan=True)


def one(effect, target, low=-1.0, high=2.0, fixed=()):
    return Candidate(effect, target, "force", fixed, 0.0, low, high, (0.5, 1.5), "N·m", tolerance=high / 10)


def test_tied_parts_share_one_candidate_on_the_same_joint_and_nothing_else_changes():
    joints = tuple(f"{leg}_{part}_joint" for leg in LEGS for part in ("hip", "knee"))
    drives = tuple(f"{leg}_{part}" for leg in LEGS for part in ("hip", "knee"))
    limits = np.full(8, np.inf)
    targets = Targets(drives, joints, (), (False,) * 8, limits, limits, tuple(range(8)))
    every = Candidate("coulomb_friction", None, "force", (), 0.0, -1.0, 2.0, (0.5,), "N·m")
    each = [one("coulomb_friction", (name,), high=2.0 + k) for k, name in enumerate(joints)]
    read_off = [one("encoder_quantization", (name,)) for name in joints]
    pool = (every, *each, *read_off)
    found = shared.tied(pool, targets, LEGS)
    assert found[:1] == (every,)
    assert set(read_off) <= set(found)  # each joint's readings say it by themselves
    tied = [c for c in found if c.effect == "coulomb_friction" and c.target is not None]
    assert [c.target for c in tied] == [tuple(f"{leg}_{part}_joint" for leg in LEGS) for part in ("hip", "knee")]
    assert tied[0].high == 2.0  # what is possible on each of them
    assert tied[0].tolerance == max(c.tolerance for c in each[::2])
    assert shared.with_shared(pool, targets, LEGS) == (*pool, *tied)
    assert tied[1].entry(0.4).target == tied[1].target


def test_what_like_parts_share_is_not_tried_twice_where_they_are_the_whole_robot():
    joints = tuple(f"{leg}_knee_joint" for leg in LEGS)
    limits = np.full(4, np.inf)
    targets = Targets(tuple(f"{leg}_knee" for leg in LEGS), joints, (), (False,) * 4, limits, limits, (0, 1, 2, 3))
    every = Candidate("coulomb_friction", None, "force", (), 0.0, -1.0, 2.0, (0.5,), "N·m")
    pool = (every, *(one("coulomb_friction", (name,)) for name in joints))
    assert shared.tied(pool, targets, LEGS) == (every,)
    assert shared.with_shared(pool, targets, LEGS) == pool


def servos(friction):
    """MJCF of legs of one joint each, with position servos, below a floating base."""
    legs = "".join(
        f'<body pos="{k} 0 -.2"><joint name="{leg}_knee_joint" axis="0 1 0" armature="0.01" damping="0.1" '
        f'frictionloss="{rub}"/><geom type="capsule" size=".015" fromto="0 0 0 0 0 -.2" mass=".4" contype="0" '
        'conaffinity="0"/></body>'
        for k, (leg, rub) in enumerate(zip(LEGS, friction, strict=False))
    )
    drives = "".join(
        f'<position name="{leg}_knee" joint="{leg}_knee_joint" kp="20" kv="0.5"/>'
        for leg, _ in zip(LEGS, friction, strict=False)
    )
    return (
        '<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><body name="base" pos="0 0 1">'
        f'<freejoint/><geom size=".1" mass="5"/>{legs}</body></worldbody><actuator>{drives}</actuator></mujoco>'
    )


def replayed(folder, friction):
    """Four recordings of 3 s of commands and positions at 100 Hz, and the model without friction."""
    folder.mkdir()
    model, rng = mujoco.MjModel.from_xml_string(servos(friction).replace("<freejoint/>", "")), np.random.default_rng(0)
    (folder / "robot.xml").write_text(servos([0.0] * len(friction)))
    drives, joints = ([kind(k).name for k in range(model.nu)] for kind in (model.actuator, model.joint))
    header = ["time", *(f"command.{name}" for name in drives), *(f"position.{name}" for name in joints)]
    for trial in range(4):
        data, rows, phase = mujoco.MjData(model), [], rng.uniform(0, 6, model.nq)
        for at in np.arange(0, 3, 0.01):
            turn = 2 * np.pi * at / (1.3 + 0.11 * np.arange(model.nq)) + phase
            goal = 0.5 * (np.sin(turn) - np.sin(phase))
            rows.append([at, *goal, *(data.qpos + rng.normal(0, 2e-4, model.nq))])
            for _ in range(5):
                data.ctrl[:] = goal
                mujoco.mj_step(model, data)
        np.savetxt(folder / f"log{trial}.csv", rows, delimiter=",", header=",".join(header), comments="", fmt="%.8g")
        facts = {"robot": "robot.xml", "interface": "position", "rate_hz": 100, "base": "fixed"}
        (folder / f"log{trial}.json").write_text(json.dumps(facts))
    return folder


@pytest.mark.slow
def test_the_leg_whose_knee_rubs_more_is_told_where_commands_are_replayed(tmp_path):
    logs = replayed(tmp_path / "logs", (0.15, 0.15, 0.6))
    found = tied_answer(tmp_path, logs, "--like", "FL,FR,RL")
    (knee,) = [row for row in found["like"] if row["name"] == "coulomb_friction" and row["place"] == "knee_joint"]
    assert knee["differs"] == ["RL"]
    assert knee["values"]["RL"]["value"] == pytest.approx(0.6, rel=0.15)
    assert knee["common"]["low"] <= 0.15 <= knee["common"]["high"]


def tied_answer(folder, log, *words):
    assert main(["diagnose", str(log), *words, "--jobs", "1", "--out", str(folder / "out")]) == 0
    return json.loads((folder / "out" / "diagnosis.json").read_text())


@pytest.mark.slow
def test_tied_legs_are_given_one_friction_and_the_one_that_differs_is_still_told(tmp_path):
    log = recorded(tmp_path, (0.15, 0.15, 0.6, 0.15), seconds=8.0)
    found = tied_answer(tmp_path, log, "--tie")
    knees = [f"{leg}_knee_joint" for leg in LEGS]
    (friction,) = [e for e in found["verdict"]["effects"] if e["name"] == "coulomb_friction" and e["target"] == knees]
    assert 0.15 < friction["parameters"]["force"]["value"] < 0.6
    assert any("share one magnitude" in note for note in found["notes"])
    (knee,) = [row for row in found["like"] if row["name"] == "coulomb_friction" and row["place"] == "knee_joint"]
    assert "RL" in knee["differs"]


def test_a_sentence_says_who_differs():
    values = {leg: Value(v, v - 0.1, v + 0.1, "N·m") for leg, v in zip(LEGS, (0.2, 0.2, 0.9, 0.2), strict=True)}
    row = Likeness("coulomb_friction", "knee_joint", "force", values, Value(0.2, 0.1, 0.3, "N·m"), 40.0, 1e-6, ("RL",))
    assert "RL differs" in sentence(row)
    assert "FL, FR and RR agree on 0.2 N·m" in sentence(row)


@pytest.mark.slow
def test_the_leg_whose_knee_rubs_is_told_from_the_three_that_are_alike(tmp_path):
    log = recorded(tmp_path, (0.15, 0.15, 0.6, 0.15))
    assert main(["diagnose", str(log), "--jobs", "1", "--out", str(tmp_path / "out")]) == 0
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert {effect["name"] for effect in found["verdict"]["effects"]} == {"coulomb_friction"}
    (knee,) = [row for row in found["like"] if row["name"] == "coulomb_friction" and row["place"] == "knee_joint"]
    assert knee["differs"] == ["RL"]
    for leg, true in zip(LEGS, (0.15, 0.15, 0.6, 0.15), strict=True):
        assert knee["values"][leg]["low"] <= true <= knee["values"][leg]["high"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Parts that are alike" in page
