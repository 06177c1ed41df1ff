"""What suits the trials that were fitted has to stand in the others, too."""

from dataclasses import replace

import numpy as np
import pytest
from made_hinge import HINGE

from benchmarks.blind import cases, recordings, robots
from benchmarks.blind.cases import EffectChoice
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.search import agreement, all_trials, state
from tiago_mj.recordings.read import read_recordings


def test_the_best_is_fitted_to_every_trial_though_the_search_looked_at_three(tmp_path, monkeypatch):
    friction = EffectChoice("coulomb_friction", ("hinge",), {"force": 0.25})
    (tmp_path / robots.PLAIN_FILE).write_text(robots.PLAIN)
    recordings.write(cases.simulate(replace(HINGE, trials=7, effects=(friction,)), tmp_path), tmp_path)
    monkeypatch.setattr(state, "FIT_STEPS", 1)
    seen = []
    fitted = all_trials.fitted
    monkeypatch.setattr(all_trials, "fitted", lambda *asked: seen.append((asked[0], fitted(*asked))) or seen[-1][1])
    trials = read_recordings([tmp_path]).trials
    names = ("coulomb_friction", "viscous_friction", "command_delay")
    found = diagnose(trials, model=tmp_path / robots.PLAIN_FILE, names=names, threads=1)
    ((before, (after, _)),) = seen
    assert len(before.full.trials) == 3
    assert len(after.full.trials) == len(found.splits["train"]) + len(found.splits["validation"]) == 5
    assert [one.name for one in found.best.effects] == ["coulomb_friction"]
    assert found.best.effects[0].parameters["force"].value == pytest.approx(0.25, rel=0.03)
    assert found.best.evidence.agreement == 1.0
    assert found.best.evidence.sharp < 1.3  # reality differs by its integrator and noise
    # Five trials of a kind would tell √(3/5) of what three leave open; these differ, and so do their samples' weights.
    assert after.best.deviations[0] < 0.9 * before.best.deviations[0]


@pytest.mark.parametrize(
    ("gained", "agreed"),
    [
        ([50.0, 40.0, 60.0], 1.0),
        ([500.0, 0.1, 0.0, -0.1], 0.999),  # a limit that one motion alone reaches
        ([112.4, -29.9, 2.1, -2.1, -1.5, 1.0, -1.0, -0.6], 0.767),  # a grasp without any effect (seed 941, case 5)
        ([0.0, 0.0], 1.0),
    ],
    ids=["all", "one excites it", "one outlier", "none tells"],
)
def test_trials_agree_by_what_they_gain_and_lose(gained, agreed):
    assert agreement._share(np.array(gained)) == pytest.approx(agreed, abs=1e-3)
