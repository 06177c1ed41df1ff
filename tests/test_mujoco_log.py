"""MuJoCo's warnings are counted by kind, and neither printed nor written into a file."""

from __future__ import annotations

import mujoco
import numpy as np

from tiago_mj.io import mujoco_log

TOO_STIFF = """
<mujoco><worldbody><body><joint name="hinge" axis="0 1 0"/><geom size=".05" pos="0 0 -.2"/></body></worldbody>
<actuator><position joint="hinge" kp="1e9"/></actuator></mujoco>
"""


def shake() -> None:
    model = mujoco.MjModel.from_xml_string(TOO_STIFF)
    data = mujoco.MjData(model)
    data.ctrl[:] = 1.0
    mujoco.mj_step(model, data, nstep=200)


def test_a_thousand_warnings_are_a_sentence_a_kind_and_no_file(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    with mujoco_log.counted() as kinds:
        for _ in range(50):
            shake()
    assert sum(kinds.values()) >= 50
    assert 1 <= len(mujoco_log.sentences(kinds)) <= 3
    assert "50 times" in " ".join(mujoco_log.sentences(kinds)) or max(kinds.values()) > 50
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")


def test_the_innermost_block_counts_and_what_was_set_before_is_set_again():
    with mujoco_log.counted() as outer:
        with mujoco_log.counted() as inner:
            shake()
        before = dict(outer)
        shake()
    assert inner
    assert not before
    assert outer


def test_two_warnings_of_one_kind_differ_by_place_and_time_alone():
    said = "Nan, Inf or huge value in QACC at DOF {}. The simulation is unstable. Time = {}."
    assert mujoco_log.kind(said.format(0, "0.0020")) == mujoco_log.kind(said.format(12, "1.5e+02"))
    assert mujoco_log.kind(said.format(0, np.nan)) != mujoco_log.kind("Inertia matrix is too close to singular")
