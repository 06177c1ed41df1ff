"""Efforts along a motion: how recordings become parts, how well efforts are known, and what friction by load needs."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from made_motions import RATE, pendulum, pendulum_file, record, trial

from tiago_mj.effects import Entry
from tiago_mj.gap.search import on_each
from tiago_mj.gap.simulation.session import session
from tiago_mj.gap.torque import flexible
from tiago_mj.gap.torque.channels import Wanted
from tiago_mj.gap.torque.measured import SHORTEST_PERIODS, _in_parts, measured
from tiago_mj.gap.torque.strips import MIXED, lay_out
from tiago_mj.gap.torque.torques import Torques


@pytest.fixture(scope="module")
def course():
    """Of one recording of twenty seconds."""
    return lay_out([record(pendulum(), ("swing",), spread=2.0)], ["swing"], ["swing"])


# Parts ----------------------------------------------------------------------------------------------------------------


def test_a_recording_is_filtered_whole_and_compared_in_parts(course):
    parts = _in_parts(course)
    assert len(parts.strips) > 5
    assert [strip.trial for strip in parts.strips[:2]] == ["trial-01", "trial-02"]
    whole = dict(zip(course.stack("time"), course.stack("effort"), strict=True))
    for strip in parts.strips:
        np.testing.assert_array_equal(strip.effort, [whole[time] for time in strip.time])


def test_rows_that_are_compared_lie_a_period_apart_from_those_of_the_next_part(course):
    parts = _in_parts(course)
    ends = [parts.of_trial(strip.trial) for strip in parts.strips]
    mixed = MIXED / course.cutoff
    for one, other in pairwise(ends):
        last, first = one.stack("time")[-1] - mixed, other.stack("time")[0] + mixed
        assert first - last >= mixed - 1e-9
        assert len(one.stack("time")) / one.rate >= SHORTEST_PERIODS / course.cutoff + 2 * mixed - 2 / one.rate


def test_nothing_is_lost_where_a_recording_is_cut(course):
    """What the filter spoils at the ends of a part is its neighbours', so that more is compared than of parts that are
    filtered alone."""
    parts = _in_parts(course)
    compared = sum(int(parts.of_trial(strip.trial).moving().sum()) for strip in parts.strips)
    gaps = (len(parts.strips) - 1) * (MIXED + 1) / course.cutoff * course.rate
    assert compared >= course.moving().sum() - gaps - 2 * len(parts.strips)


def test_a_recording_too_short_for_two_parts_is_one():
    short = lay_out([record(pendulum(), ("swing",), spread=2.0, seconds=4.0)], ["swing"], ["swing"], share=1 / 8)
    assert len(_in_parts(short).strips) == 1


def test_parts_of_one_length_are_filtered_as_each_alone(course):
    parts, rng = _in_parts(course), np.random.default_rng(0)
    values = rng.standard_normal((sum(parts.lengths), 2))
    together = np.split(parts.filtered(values), np.cumsum(parts.lengths)[:-1])
    for strip, found, one in zip(parts.strips, together, np.split(values, np.cumsum(parts.lengths)[:-1]), strict=True):
        np.testing.assert_allclose(found, parts.of_trial(strip.trial).filtered(one), atol=1e-12)


def fast(course, share=0.2):
    """Rows in which the first joint is faster than a share of its fastest."""
    speed = np.abs(course.stack("velocity")[:, 0])
    return course.moving()[:, 0] & (speed > share * speed.max())


def sticking(friction=0.3, seconds=20.0):
    """A servo swings a pendulum that sticks where it turns; positions and torques of every fifth step of 1 ms."""
    model, rows = pendulum(), []
    model.opt.timestep, model.dof_frictionloss[0] = 0.001, friction
    data = mujoco.MjData(model)
    for step in range(int(1000 * seconds)):
        goal = 0.6 * np.sin(2 * np.pi * data.time / 1.3)
        data.ctrl[:] = torque = 20 * (goal - data.qpos[0]) - 0.5 * data.qvel[0]
        if step % 5 == 0:
            rows.append((data.time, data.qpos[0], torque))
        mujoco.mj_step(model, data)
    time, position, effort = np.array(rows).T
    return trial(time, {"swing": position}, {"swing": effort})


@pytest.mark.parametrize("has", [0.02, 0.3])
def test_rows_near_a_turn_are_known_as_badly_as_the_filter_mixes_them_with_a_joint_that_sticks(has):
    """Between slip and slip friction has any value; at the true friction the rest is left to as much, and elsewhere
    less than a hundredth of it is (the controller's step makes that)."""
    course = lay_out([sticking(friction=0.3)], ["swing"], ["swing"])
    model = pendulum()
    model.dof_frictionloss[0] = has
    torques = Torques(model, course)
    found = torques.of([Entry("coulomb_friction", None, {"force": 0.3 - has})])[:, 0]
    effort = course.stack("effort")
    left, leaked = effort[:, 0] - found, course.leaked(effort - torques.frictionless)[:, 0]
    compared = course.moving()[:, 0] & (course.stack("time") > 1) & (course.stack("time") < 19)
    near = compared & (leaked > 0.01)
    assert np.abs(left[near]).max() > 0.03  # a tenth of the friction
    assert 0.5 < np.sqrt(np.mean((left[near] / leaked[near]) ** 2)) < 1.5
    turning = compared & (np.abs(course.stack("velocity")[:, 0]) < course.rest_speed[0])
    assert turning.sum() > 20
    assert 0.5 < np.sqrt(np.mean((left[turning] / leaked[turning]) ** 2)) < 1.5
    assert np.abs(left[compared & (leaked < 0.001)]).max() < 0.003
    assert (compared & (leaked < 0.001)).sum() > 0.7 * compared.sum()


def standing(moves, seconds):
    """A recording after whose end the robot stands still."""
    rows = round(seconds * RATE)
    still = {
        kind: {joint: np.pad(values, (0, rows), mode="edge") for joint, values in getattr(moves, kind).items()}
        for kind in ("positions", "efforts")
    }
    return replace(moves, time=np.arange(len(moves.time) + rows) / RATE, **still)


def test_rows_of_a_long_rest_are_not_compared():
    """Its friction is one unknown number, however many rows it lasts."""
    course = lay_out([standing(record(pendulum(), ("swing",), spread=2.0), 10.0)], ["swing"], ["swing"])
    stands = course.stack("time") > 20.0
    assert course.moving()[~stands, 0].mean() > 0.9
    assert not course.moving()[stands].any()


def test_parts_of_which_nothing_is_compared_are_no_trials():
    """Else a part in which the robot stands still may be all that is kept aside."""
    recorded = standing(record(pendulum(), ("swing",), spread=2.0, seconds=12.0), 6.0)
    whole = session([recorded], model=pendulum_file())
    found = measured(whole, [recorded], Wanted(["swing"]), 1.0)
    parts = len(_in_parts(found.usable.course).strips)
    rows = np.isfinite(found.predict.data.value).sum(axis=(1, 2))
    assert len(rows) == len(found.session.trials) < parts
    assert rows.min() > 0
    assert rows[list(found.session.subset("test"))].sum() > 0.1 * rows.sum()


# How well efforts are known -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("rows", "within"), [(6, 1.5), (12, 0.5), (30, 0.2), (200, 0.05)])
def test_noise_is_found_beside_columns_that_could_fit_it(rows, within):
    """Twenty columns, one of which is there, and a model with none: least squares would leave nothing of twelve rows.

    The median of forty draws. Two hundred rows tell a deviation to 1/√400, thirty beside twenty columns to 1/√20.
    """
    rng, found = np.random.default_rng(1), []
    for _ in range(40):
        columns = rng.standard_normal((20, rows))
        gap = 2.0 * columns[0] + 0.3 * rng.standard_normal(rows)
        found.append(flexible.noise_beside(gap, [columns[:0], 2.0 / 20**0.5 * columns])[0])
    assert np.median(found) == pytest.approx(0.3, rel=within)
    assert min(found) > 0.05


# Friction by load -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.1, 0.35, 0.7])
def test_friction_by_load_is_part_of_the_load_that_it_follows(course, share):
    """τ = τ₀ + c|τ| sign(v): τ₀/(1 − c) where the drive lifts, τ₀/(1 + c) where it brakes."""
    torques = Torques(pendulum(), course)
    alone = torques.nominal[:, 0]
    found = torques.of([Entry("load_dependent_friction", None, {"coefficient": share})])[:, 0]
    lifts = alone * course.stack("velocity")[:, 0] > 0
    wanted = alone / np.where(lifts, 1 - share, 1 + share)
    far = fast(course) & (np.abs(alone) > 0.5 * np.abs(alone).max())  # the filter rounds what is near a turn
    assert 0 < lifts[far].sum() < far.sum()
    error = np.abs(found[far] / wanted[far] - 1)
    assert np.median(error) < 0.002
    assert np.quantile(error, 0.98) < 0.05


def test_an_effort_that_is_given_is_what_friction_follows(course):
    torques = Torques(pendulum(), course)
    entry = Entry("load_dependent_friction", None, {"coefficient": 0.5})
    given = np.full_like(torques.nominal, 2.0)
    more = torques.of([entry], effort=given) - torques.nominal
    np.testing.assert_allclose(np.abs(more[fast(course, 0.5)]), 1.0, rtol=0.01)


def test_without_dry_friction_there_is_none_by_load_that_is_given_either(course):
    torques = Torques(pendulum(), course, (Entry("load_dependent_friction", None, {"coefficient": 0.5}),))
    rubs = np.abs(torques.nominal - torques.frictionless)[:, 0] - 0.02  # the model's own
    loaded = fast(course) & (np.abs(torques.nominal[:, 0]) > 0.5 * np.abs(torques.nominal).max())
    np.testing.assert_allclose(rubs[loaded], 0.5 * np.abs(torques.nominal[loaded, 0]), rtol=0.1)


# Needless effects -----------------------------------------------------------------------------------------------------


def test_what_is_needless_on_a_joint_is_left_out_until_all_is_needed(monkeypatch):
    def fit(*values):
        parts = tuple(SimpleNamespace(label=k, identity=0.0) for k in range(len(values)))
        ones = np.ones(len(values))
        return SimpleNamespace(parts=parts, values=np.array(values), deviations=ones, nuisance=np.zeros(0))

    # The second fit finds one more that is needless, since the first one had shared with it.
    again = iter([fit(3.0, 0.2), fit(3.0)])
    fitter = SimpleNamespace(fit_all=lambda starts: [next(again)])
    monkeypatch.setattr(on_each.ranking, "differs_from_identity", lambda one, k, least: one.values[k] > least)
    (found,) = on_each.without_needless(fitter, fit(3.0, 0.0, 2.0), 1.0)
    assert found.values.tolist() == [3.0]
    # Of two that stand in for each other the lesser goes, and the other one is needed then.
    again, tried = iter([fit(3.0, 1.5)]), []
    fitter = SimpleNamespace(fit_all=lambda starts: tried.extend(starts) or [next(again)])
    (found,) = on_each.without_needless(fitter, fit(3.0, 0.4, 0.7), 1.0)
    assert found.values.tolist() == [3.0, 1.5]
    assert [start.values.tolist() for start in tried] == [[3.0, 0.7]]
    whole = fit(3.0, 2.0)
    assert on_each.without_needless(fitter, whole, 1.0) == [whole]
