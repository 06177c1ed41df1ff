"""The gripper in another engine: recordings that the nominal simulator has to be right about."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

pytest.importorskip("pybullet")

from benchmarks.blind import bullet, cases, recordings, robots


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
    made = bullet.simulate(bullet.Variant(), seed=1, trials=2, seconds=5.0)
    force = made.recorded.force
    assert (force > 10 * robots.FORCE_NOISE).any()
    assert not (force[:, :12] > 10 * robots.FORCE_NOISE).any(), "it starts open"
    recordings.write(made, tmp_path)
    assert "force.right" in pq.read_schema(tmp_path / "trial-00.parquet").names
    assert '"name": "ideal"' in (tmp_path / "trial-00.json").read_text()


def test_every_contact_point_there_is_a_spring_of_its_own() -> None:
    whole = bullet.simulate(bullet.Variant(), seed=3, trials=2, seconds=5.0)
    mean = bullet.simulate(bullet.Variant(aggregate="mean"), seed=3, trials=2, seconds=5.0)
    # One point has the 10 kN/m that the object was given (the encoder's noise is a tenth of the depth); the pad rests
    # on two to four, so that the grasp is stiffer than the number says.
    assert stiffness(mean) == pytest.approx(10_000, rel=0.3)
    assert stiffness(whole) > 1.6 * stiffness(mean)
