"""The gripper in another engine: recordings that the nominal simulator has to be right about."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

pytest.importorskip("pybullet")

from benchmarks import bullet_story
from benchmarks.blind import bullet, cases, recordings, robots

SECONDS = 1.5


def stiffness(made: cases.Made) -> float:
    """Force over approach of one pad and the object, where it is pressed [N/m]."""
    q, force = made.recorded.position, made.recorded.force
    # Pads meet the object, 40 mm wide, where their gap 2 q + 0.4 mm is that wide.
    depth = 0.0396 - q.sum(axis=2)
    newtons = force.sum(axis=2) / robots.UNITS_PER_NEWTON
    pressed = newtons > 4.0
    assert pressed.sum() > 10
    return float(np.median(newtons[pressed] / depth[pressed]))


def test_the_other_engine_closes_on_the_same_object_and_writes_recordings(tmp_path: Path) -> None:
    made = bullet.simulate(bullet.Variant(), seed=1, trials=2, seconds=SECONDS)
    force = made.recorded.force
    assert (force > 10 * robots.FORCE_NOISE).any()
    assert not (force[:, :12] > 10 * robots.FORCE_NOISE).any(), "it starts open"
    recordings.write(made, tmp_path)
    assert "force.right" in pq.read_schema(tmp_path / "trial-00.parquet").names
    assert '"name": "ideal"' in (tmp_path / "trial-00.json").read_text()


def test_every_contact_point_there_is_a_spring_of_its_own() -> None:
    whole = bullet.simulate(bullet.Variant(aggregate="sum"), seed=3, trials=2, seconds=SECONDS)
    mean = bullet.simulate(bullet.Variant(), seed=3, trials=2, seconds=SECONDS)
    # One point has the 10 kN/m that the object was given (the encoder's noise is a tenth of the depth); the pad rests
    # on two to four, so that the grasp is stiffer than the number says.
    assert stiffness(mean) == pytest.approx(10_000, rel=0.3)
    assert stiffness(whole) > 1.6 * stiffness(mean)
    # What it says of itself is the same thing without noise.
    assert whole.truth["stiffness"] == pytest.approx(stiffness(whole), rel=0.1)


def test_only_a_limit_that_bullet_is_given_holds_the_fingers_back() -> None:
    free, held = (
        bullet.simulate(bullet.Variant(force=force, aggregate="sum"), seed=3, trials=4, seconds=SECONDS)
        for force in (None, 6.0)
    )
    limit = (6.0 + 2.0) * robots.UNITS_PER_NEWTON  # a finger at 0.02 m/s brings an impact of its own
    assert held.recorded.force.max() < limit < free.recorded.force.max()


def test_a_grasp_gives_way_there_unless_the_solver_has_the_iterations_to_hold_it() -> None:
    later = {}
    for iterations in (bullet.Variant().iterations, bullet_story.ENOUGH):
        variant = bullet.Variant(aggregate="sum", iterations=iterations)
        made = bullet.simulate(variant, seed=1, trials=1, seconds=2.5, programs=[bullet_story.press_and_hold()])
        force = made.recorded.force[0].mean(axis=1)
        still = int(np.flatnonzero(made.recorded.commands[0, :-1, 0])[-1]) + 1
        assert force[still] > 5 * robots.UNITS_PER_NEWTON
        later[iterations] = force[still + 240 : still + 260].mean() / force[still]
    few, enough = later.values()
    assert few < 0.2
    assert enough > 0.9


def test_a_command_that_is_no_whole_number_of_steps_is_refused() -> None:
    with pytest.raises(ValueError, match="whole number"):
        bullet.simulate(bullet.Variant(rate=25.0), seed=0, trials=1, seconds=SECONDS)
    assert bullet.Variant(rate=24.0).substeps == 10


def test_what_a_verdict_names_is_undone_in_the_other_engine() -> None:
    stiff = {"name": "contact_stiffness", "parameters": {"factor": {"value": 2.0}}}
    wide = {"name": "object_size", "parameters": {"radius": {"value": 0.001}}}
    changed = bullet_story.undone(bullet.Variant(), [stiff, wide])
    assert changed is not None
    assert (changed.stiffness, changed.radius) == pytest.approx((5_000.0, 0.019))
    assert bullet_story.undone(bullet.Variant(), []) is None, "nothing was named"
    lag = {"name": "force_lag", "parameters": {"time_constant": {"value": 0.01}}}
    assert bullet_story.undone(bullet.Variant(), [lag]) is None, "Bullet has no lag to take away"
    assert bullet_story.undone(bullet.Variant(), [stiff, lag]) == bullet.Variant(stiffness=5_000.0)
