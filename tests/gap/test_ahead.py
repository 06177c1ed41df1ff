"""What a diagnosis expects to have ahead of it."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_hinge import HINGE

from benchmarks.blind import cases, recordings, robots
from benchmarks.blind.cases import EffectChoice
from tiago_mj.gap.ahead import TYPICAL, Ahead, Typical
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.io.progress import Estimate
from tiago_mj.recordings.read import read_recordings


class Heard(list):
    """What a listener was told."""

    def __call__(self, stage, done, left):
        self.append((stage, done, left))


def test_at_its_beginning_a_stage_leaves_its_median():
    assert Typical(100.0, 0.5).left(0.0) == pytest.approx(100.0)


def test_what_was_done_without_an_end_is_evidence_that_more_is_left():
    typical = Typical(100.0, 0.5)
    # Of those that take the median at least, half take exp(0.674 x 0.5) of it.
    assert typical.left(100.0) == pytest.approx(100.0 * math.exp(0.6745 * 0.5) - 100.0, rel=1e-3)
    assert typical.left(50.0) > 100.0 - 50.0
    assert typical.left(50.0) < 100.0


@given(st.floats(1e-3, 1e6), st.floats(0.05, 3.0), st.floats(0.0, 1e9))
def test_what_is_left_is_positive_and_finite_however_long_it_takes(median, spread, done):
    left = Typical(median, spread).left(done)
    assert 0.0 <= left < math.inf


def test_a_listener_hears_of_stages_and_of_work_in_steps():
    heard = Heard()
    told = Ahead(heard)
    told("replaying")
    told.worked(30)
    assert heard == [("replaying", 0.0, None), ("replaying", 30.0, None)]
    told.measured_in(10.0)
    told("screening", gap=True)
    assert heard[-1] == ("screening", 30.0, pytest.approx(10.0 * TYPICAL["screening, a gap"].median))
    told("screening")  # goes on
    told.worked(100)
    stage, done, left = heard[-1]
    assert (stage, done) == ("screening", 130.0)
    assert left == pytest.approx(10.0 * TYPICAL["screening, a gap"].left(10.0))


def test_no_more_is_left_than_the_search_may_take():
    heard = Heard()
    told = Ahead(heard)
    told.measured_in(10.0, most=1000.0)
    told("pairs", gap=True)
    told.worked(900)
    assert heard[-1][2] == pytest.approx(100.0 + 10.0 * TYPICAL["writing"].median)
    told.worked(500)
    assert heard[-1][2] == pytest.approx(10.0 * TYPICAL["writing"].median)


STAGE = st.sampled_from([key.split(", ")[0] for key in TYPICAL] + ["something else"])


@given(st.lists(st.tuples(STAGE, st.booleans() | st.none(), st.floats(0, 1e7)), max_size=40))
def test_the_share_never_falls_whatever_stages_come_and_come_again(ticks):
    estimate, shares = Estimate(), [0.0]

    def listen(stage, done, left):
        assert left is None or 0.0 <= left < math.inf
        estimate.worked(done, left, float(len(shares)))
        shares.append(estimate.share)

    told = Ahead(listen)
    told.measured_in(9000.0, 900 * 9000.0)
    for stage, gap, steps in ticks:
        told(stage, gap=gap)
        told.worked(steps)
    assert shares == sorted(shares)
    assert shares[-1] <= 1.0


def test_a_diagnosis_tells_the_physics_steps_that_it_makes(tmp_path):
    """Through the pipeline: the work told at the end is the result's, and from the search on more is expected."""
    friction = EffectChoice("coulomb_friction", ("hinge",), {"force": 0.25})
    model = tmp_path / robots.PLAIN_FILE
    model.write_text(robots.PLAIN)
    recordings.write(cases.simulate(replace(HINGE, trials=3, effects=(friction,)), tmp_path), tmp_path)
    trials = read_recordings([tmp_path]).trials
    heard = Heard()
    found = diagnose(trials, model=model, names=("coulomb_friction", "viscous_friction"), threads=1, tick=heard)
    assert heard[-1][1] == found.physics_steps
    searching = [left for stage, _, left in heard if stage == "screening"]
    assert searching
    assert None not in searching
    assert [stage for stage, _, _ in heard if stage == "weighing"]
