"""Noise of positions is the recording's own where it can be told, and what a sidecar states where it states one."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml
from real_recordings import real

from tiago_mj.gap.inference import noise_model, sensor_noise
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.read import read_recordings

SLIDE, HINGE = sensor_noise.MIN_NOISE["position"]
#: A carriage that goes to and fro and rests, 1 kHz [m].
TIME = np.arange(4000) / 1000
MOTION = np.where(TIME % 2 < 1.2, 0.1 * np.sin(2 * np.pi * TIME / 1.2), 0.0)
ROBOT = """
<mujoco><worldbody><body><joint name="axis" type="slide"/><geom size="0.1" mass="1"/></body></worldbody>
<actuator><position name="axis" joint="axis" kp="100" kv="10"/></actuator></mujoco>
"""


@pytest.mark.parametrize("noise", [2e-8, 5e-7, 1e-5])
def test_an_encoder_a_thousand_times_better_is_told_from_its_readings(noise):
    values = (MOTION + noise * np.random.default_rng(0).standard_normal(len(MOTION)))[None]
    assert sensor_noise.least("position", values, slide=True) == pytest.approx(noise, rel=0.15)
    late = values.copy()
    late[:, np.arange(values.shape[1]) % 4 != 0] = np.nan  # it is read in every fourth row
    assert sensor_noise.least("position", late, slide=True) == pytest.approx(noise, rel=0.25)


@pytest.mark.parametrize(
    "values",
    [
        MOTION,  # a simulator without noise: rounding is no sensor's
        np.sin(40 * TIME),  # it never rests
        np.round(MOTION / 1e-4) * 1e-4,  # a converter in which nothing flickers
        MOTION + 0.9 * SLIDE * np.random.default_rng(0).standard_normal(len(MOTION)),  # hardly less
    ],
    ids=["exact", "swing", "grid", "as good as assumed"],
)
def test_what_readings_do_not_tell_is_assumed(values):
    assert sensor_noise.least("position", values[None], slide=True) == SLIDE
    assert sensor_noise.least("velocity", values[None], slide=True) == sensor_noise.MIN_NOISE["velocity"][0]


def test_more_noise_than_assumed_is_told_as_before():
    values = (MOTION + 1e-3 * np.random.default_rng(0).standard_normal(len(MOTION)))[None]
    least = sensor_noise.least("position", values, slide=False)
    assert least == HINGE
    assert sensor_noise.floor(values, least) == pytest.approx(1e-3, rel=0.1)


@pytest.mark.parametrize("where", ["sidecar", "map"])
@pytest.mark.parametrize("stated", [1e-6, 1e-3])
def test_a_stated_uncertainty_is_obeyed_be_it_smaller_or_larger(tmp_path, where, stated):
    (tmp_path / "robot.xml").write_text(ROBOT)
    held = {"time": TIME, "command.axis": MOTION, "position.axis": MOTION}
    rows = "\n".join(",".join(f"{value:.17g}" for value in row) for row in zip(*held.values(), strict=True))
    (tmp_path / "log.csv").write_text(f"{','.join(held)}\n{rows}\n")
    facts, said = {"robot": "robot.xml", "interface": "position"}, {"uncertainty": {"position": stated}}
    (tmp_path / "log.json").write_text(json.dumps({**facts, **(said if where == "sidecar" else {})}))
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(said if where == "map" else {"rate_hz": 1000}))
    trials = read_recordings([tmp_path / "log.csv"], map_file=tmp_path / "map.yaml").trials
    data = noise_model.collect(plant_of(trials, model=tmp_path / "robot.xml"), trials)
    assert data.noise == pytest.approx([stated])


def test_the_encoder_of_a_real_axis_is_a_thousand_times_better_than_a_fingers():
    loadmat = pytest.importorskip("scipy.io").loadmat
    position = loadmat(real("emps/DATA_EMPS.mat"))["qm"].astype(float).reshape(1, -1)
    assert SLIDE / 2000 < sensor_noise.least("position", position, slide=True) < SLIDE / 500
