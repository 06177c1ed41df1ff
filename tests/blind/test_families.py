"""Families that the diagnosis once got wrong, in the independent reality, with other magnitudes and seeds."""

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.blind import cases, recordings, robots
from benchmarks.blind.cases import FAST_RATE, Case, EffectChoice
from tiago_mj.gap.diagnose import diagnose
from tiago_mj.gap.read import read_recordings

PLAIN = Case(seed=4242, setting="plain", interface="position", spread=0.04, rate=FAST_RATE, seconds=1.6, trials=4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "parameters"),
    [("velocity_filter", {"time_constant": 0.05})],
)
def test_a_lag_of_two_poles_is_one_effect_and_its_time_constant_is_found(
    tmp_path: Path, name: str, parameters: dict[str, float]
) -> None:
    case = replace(PLAIN, effects=(EffectChoice(name, "all", parameters),))
    (tmp_path / robots.PLAIN_FILE).write_text(robots.PLAIN)
    recordings.write(cases.simulate(case, tmp_path), tmp_path)
    found = diagnose(read_recordings([tmp_path]).trials, model=tmp_path / robots.PLAIN_FILE, threads=2)
    (effect,) = found.best.effects
    assert (found.kind, effect.name) == ("effect", name)
    # Of a servo's own lag, some 40 ms, nobody knows more than a few per cent.
    assert effect.parameters["time_constant"].value == pytest.approx(parameters["time_constant"], rel=0.06)
