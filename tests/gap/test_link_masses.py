"""Masses of a user's own model are known to some per cent, wherever commands are replayed."""

import json

import mujoco
import numpy as np
import pytest

from tiago_mj.gap.inference.hypotheses import terms
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.read import read_recordings

ARM = """
<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody>
<body><joint name="shoulder" axis="0 1 0" damping=".3" armature=".02" frictionloss="0.05"/>
<geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" mass="1.5"/>
<body pos=".3 0 0"><joint name="elbow" axis="0 1 0" damping=".2" armature=".01" frictionloss="0.03"/>
<geom type="capsule" size=".025" fromto="0 0 0 .25 0 0" mass="{mass}"/></body></body></worldbody>
<actuator><position name="shoulder" joint="shoulder" kp="120" kv="6"/>
<position name="elbow" joint="elbow" kp="60" kv="3"/></actuator></mujoco>
"""
JOINTS = ("shoulder", "elbow")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Recordings of an arm whose forearm weighs 7 % more than the model's."""
    folder, model = tmp_path_factory.mktemp("arm"), mujoco.MjModel.from_xml_string(ARM.format(mass=0.8 * 1.07))
    rng = np.random.default_rng(11)
    for k in range(5):
        data, rows, sent = mujoco.MjData(model), [], np.zeros(2)
        goals = np.repeat(np.cumsum(rng.uniform(-0.5, 0.5, (8, 2)), axis=0).clip(-1.2, 1.2), 40, axis=0)
        for row, goal in enumerate(goals):
            sent = sent + np.clip(goal - sent, -0.03, 0.03)
            rows.append((0.02 * row, *sent, *(data.qpos + rng.normal(0, 1e-4, 2))))
            data.ctrl[:] = sent
            mujoco.mj_step(model, data, 10)
        lines = "\n".join(",".join(f"{value:.9g}" for value in row) for row in rows)
        named = ",".join(f"{kind}.{joint}" for kind in ("command", "position") for joint in JOINTS)
        (folder / f"t{k}.csv").write_text(f"time,{named}\n{lines}\n")
        start = {"position": dict.fromkeys(JOINTS, 0.0), "set_point": dict.fromkeys(JOINTS, 0.0)}
        facts = {"robot": "robot.xml", "interface": "position", "rate_hz": 50, "initial": start}
        (folder / f"t{k}.json").write_text(json.dumps(facts))
    (folder / "robot.xml").write_text(ARM.format(mass=0.8))
    return folder


def test_every_link_but_the_tools_has_a_mass_of_its_own_known_to_five_per_cent(folder):
    """The tool's is the payload's number."""
    plant = plant_of(read_recordings([folder]).trials, model=folder / "robot.xml")
    masses = {term.target: term.deviation for term in terms(plant) if term.effect == "link_mass"}
    assert masses == {("shoulder",): 0.05}
    assert any(term.effect == "payload" for term in terms(plant))


@pytest.mark.slow
@pytest.mark.parametrize(("stated", "kind"), [(None, "no_gap"), (1e-4, "effect")])
def test_a_link_a_little_heavier_is_no_gap_and_no_clock(folder, stated, kind):
    """With masses known exactly a clock that is off is named: its error grows with the way, as the weight's does."""
    said = {} if stated is None else {"defaults": {"uncertainty": {"link_mass": stated}}}
    found = diagnose(read_recordings([folder], **said).trials, names=("clock_skew",), threads=1)
    assert found.kind == kind
