"""What changed between two sets of recordings: fitters of differences, the whole answer, files, and bad input."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_hinge import HINGE

from benchmarks.blind import cases, changes, recordings, robots
from benchmarks.blind.cases import EffectChoice
from benchmarks.blind.changes import Pair
from tiago_mj import cli
from tiago_mj.change import comparison, history, report, result, search
from tiago_mj.change.comparison import compare, renamed
from tiago_mj.change.fitters import DifferenceFitter, JointFitter, differences
from tiago_mj.gap.decision import verdict
from tiago_mj.gap.inference import hypotheses, noise_model
from tiago_mj.gap.inference.fit import Fitted, Point, Start
from tiago_mj.gap.inference.predictor import predictor
from tiago_mj.gap.parts import Named, Value
from tiago_mj.gap.search.state import Ranked
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.gap.simulation.subset import Subset
from tiago_mj.recordings.read import read_recordings

NOTHING = Point((), np.zeros(0), np.zeros(0))
FRICTION = EffectChoice("coulomb_friction", "all", {"force": 0.25})


def made(folder: Path, *, after=(), same=True):
    """Two sets of recordings of a hinge, read and renamed; its model's file."""
    pair = Pair(HINGE, replace(HINGE, effects=after), "appears", None, same)
    for which, session in zip(("before", "after"), changes.record(pair, folder), strict=True):
        recordings.write(session, folder / which)
    model = folder / robots.PLAIN_FILE
    sets = [renamed(read_recordings([folder / which]).trials, which) for which in ("before", "after")]
    return sets, model


@pytest.fixture(scope="module")
def hinges(tmp_path_factory):
    sets, model = made(tmp_path_factory.mktemp("hinges"), after=(FRICTION,))
    trials = [*sets[0], *sets[1]]
    predict, _ = predictor(plant_of(trials, model=model), trials, threads=1)
    return predict, trials


def friction(predict):
    pool = hypotheses.candidates(predict.plant, ["coulomb_friction"])
    return next(candidate for candidate in pool if candidate.effect == "coulomb_friction")


def test_recordings_that_repeat_the_same_commands_are_paired(hinges):
    _, trials = hinges
    assert search.repeated(trials, range(4, 8), range(4)) == [(4, 0), (5, 1), (6, 2), (7, 3)]
    moved = replace(trials[4], commands={name: sent + 0.01 for name, sent in trials[4].commands.items()})
    assert search.repeated([*trials[:4], moved, *trials[5:]], range(4, 8), range(4)) == [(5, 1), (6, 2), (7, 3)]


def test_a_candidate_acts_in_the_changed_set_alone(hinges):
    predict, _ = hinges
    data, part = predict.data, friction(predict)
    fitter = JointFitter(
        predict,
        Subset((0, 4)),
        noise_model.select_trials(data, [0, 4]),
        np.ones(2),
        (),
        np.zeros((0, 2)),
        changed=frozenset({4}),
    )
    with_it, without = fitter.predictions(
        [Point((part,), np.array([0.25]), np.zeros(0)), Point((), np.zeros(0), np.zeros(0))]
    )
    assert np.array_equal(with_it[0], without[0])
    assert np.abs(with_it[1] - without[1]).max() > 1e-3


def test_a_change_that_leaves_more_than_noise_is_named_where_it_explains_the_larger_part(hinges):
    predict, _ = hinges
    part, none = friction(predict), np.zeros(0)
    nothing = Fitted((), none, none, none, -1e5, 1000.0, nuisance_deviations=none)

    def judged(left):
        found = Fitted((part,), np.array([0.25]), np.array([0.01]), none, -2e3, left, nuisance_deviations=none)
        ranked = Ranked((found, nothing), (), 0, 1, True, np.ones(2), predict)
        before = verdict.judge(ranked)
        assert before.kind == "unknown"
        return comparison.larger_part(ranked, before)

    assert judged(60.0).kind == "effect"
    assert judged(60.0).remains
    assert judged(600.0).kind == "unknown"


def test_a_difference_of_recordings_is_predicted_by_the_difference_of_simulations(hinges):
    predict, _ = hinges
    base = predict.all_trials([()], range(8))[0]
    pairs = [(4, 0), (5, 1)]
    data, part = differences(predict.data, base, pairs), friction(predict)
    fitter = DifferenceFitter(predict, Subset((4, 5)), data, np.ones(2), (), np.zeros((0, 2)), partner=dict(pairs))
    point = Point((part,), np.array([0.25]), np.zeros(0))
    changed = predict.all_trials([(part.entry(0.25),)], [4, 5])[0]
    np.testing.assert_allclose(fitter.predictions([point])[0], changed - base[:2])
    nothing = fitter.predictions([Point((), np.zeros(0), np.zeros(0))])[0]
    left = [
        float(np.nanmean((data.value - one) ** 2 / data.sigma**2)) for one in (nothing, fitter.predictions([point])[0])
    ]
    assert left[1] < 2 < left[0]


def test_an_effect_of_one_set_gains_over_the_same_effect_in_both(hinges):
    predict, _ = hinges
    data, part = noise_model.select_trials(predict.data, [0, 4]), friction(predict)
    fitter = JointFitter(
        predict, Subset((0, 4)), data, np.ones(2), (), np.zeros((0, *data.value.shape)), changed=frozenset({4})
    )
    fit = fitter.fit_all([Start((part,), np.array([0.2]))])[0]
    ranked = Ranked((fit,), (), 0, 1, True, np.ones(2), predict)
    (gain,) = search.gains_of_change(search.Found(ranked, 0, fitter), [0])
    assert gain > 50
    assert fit.values[0] == pytest.approx(0.25, rel=0.1)
    pair = differences(predict.data, predict.all_trials([()], range(8))[0], [(4, 0)])
    alike = DifferenceFitter(
        predict, Subset((4,)), pair, np.ones(2), (), np.zeros((0, *pair.value.shape)), partner={4: 0}
    )
    (gain,) = search.gains_of_change(search.Found(ranked, 1, alike), [0])
    assert gain > 50


def test_noise_of_differences_is_read_off_them(hinges):
    predict, _ = hinges
    base = predict.all_trials([()], range(8))[0]
    data = differences(predict.data, base, [(4, 0), (5, 1), (6, 2), (7, 3)])
    assert data.noise == pytest.approx(np.sqrt(2) * np.array(robots.PLAIN_NOISE), rel=0.25)


@pytest.mark.slow
def test_a_friction_that_appears_is_named_with_its_size(tmp_path):
    sets, model = made(tmp_path, after=(FRICTION,))
    found = compare(*sets, model=model, threads=1)
    assert found.kind == "changed"
    (change,) = found.best.changes
    assert (change.name, change.acts_in, change.before) == ("coulomb_friction", "after", 0.0)
    assert change.amount.low < 0.25 < change.amount.high
    assert found.same_commands == 4


@pytest.mark.slow
def test_where_nothing_changed_nothing_is_named_whatever_both_have(tmp_path):
    unknown = cases.choose("plain", "cable_tug", np.random.default_rng(3))
    pair = Pair(*(replace(HINGE, effects=(unknown,)) for _ in range(2)), "none", None, same_motion=False)
    for which, session in zip(("before", "after"), changes.record(pair, tmp_path), strict=True):
        recordings.write(session, tmp_path / which)
    words = [str(tmp_path / "before"), str(tmp_path / "after"), "--model", str(tmp_path / robots.PLAIN_FILE)]
    assert cli.main(["compare", *words, "--out", str(tmp_path / "out"), "--jobs", "1"]) == 0
    assert result.KEPT.load(tmp_path / "out" / result.FILE_NAME).kind == "nothing_changed"


# Files ----------------------------------------------------------------------------------------------------------------


def answer(kind="changed", before=0.1, after=0.25, evil="hinge"):
    """A made answer."""
    amount = Value(0.15, 0.13, 0.17, "N·m")
    change = result.Change("coulomb_friction", evil, "force", "after", amount, before, after, {})
    best = result.Explanation((change,), 0.9, 120.0, 1.1)
    nothing = result.Explanation((), 0.02, 0.0, 9.0)
    side = result.Side((f"{evil}-00",), "january", "2026-01-15")
    said = nothing if kind == "nothing_changed" else best
    return result.Comparison(
        kind=kind,
        probability=said.probability,
        best=said,
        alternatives=(said,),
        ranking=(best, nothing),
        before=side,
        after=side,
        common=(Named("backlash", "all", {"width": Value(0.01, None, None, "rad")}),),
        reference="before",
        same_commands=4,
        robot="pendulum",
        findings=(),
        notes=(),
        complete=True,
        physics_steps=1000,
        seconds=1.0,
        seed=0,
        version="0",
    )


def test_a_comparison_is_read_back_as_it_was_written(tmp_path):
    found = answer()
    paths = report.write(found, tmp_path)
    assert result.text(result.KEPT.load(paths[result.FILE_NAME])) == result.text(found)


def test_names_of_files_run_nothing_in_the_page():
    page = report.render(answer(evil="<script>alert(1)</script>\u202e"))
    assert "<script>alert" not in page
    assert "\u202e" not in page


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("changed", "Coulomb friction on hinge changed"),
        ("nothing_changed", "Nothing changed"),
        ("ambiguous", "do not tell which"),
        ("unknown_change", "no effect of the library explains it"),
    ],
)
def test_the_first_line_says_the_answer(kind, said):
    assert said in report.lines(answer(kind), {})[0][1]


def test_a_life_shows_what_left_its_interval(tmp_path):
    for day, before, after in (("2026-01", 0.1, 0.25), ("2026-02", 0.25, 0.5)):
        report.write(answer(before=before, after=after), tmp_path / "life" / day)
    with pytest.raises(ValueError, match="are no history"):
        history.read(tmp_path, lambda one, other: answer())
    life = history.read(tmp_path / "life", lambda one, other: answer())
    (track,) = life.tracks
    assert [point.date for point in track.points] == ["2026-01", "2026-02"]
    assert [point.left for point in track.points] == [False, True]
    assert any("left its interval" in one for one in history.look(life))
    assert "<svg" in history.render(life)


# Bad input ------------------------------------------------------------------------------------------------------------


def refused(capsys, *words):
    assert cli.main(["compare", *map(str, words)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    return said.err


def test_what_cannot_be_compared_is_said_in_one_line(tmp_path, capsys):
    out = ("--out", tmp_path / "out")
    assert "give two sets" in refused(capsys, tmp_path, *out)
    assert "is given twice" in refused(capsys, tmp_path, tmp_path, *out)
    assert "no such file or folder" in refused(capsys, tmp_path / "a", tmp_path / "b", *out)
    assert "write two days" in refused(capsys, tmp_path / "a", tmp_path / "b", "--dates", "today", *out)
    assert "no such folder" in refused(capsys, "--history", tmp_path / "nowhere", *out)
    assert "not both" in refused(capsys, tmp_path, tmp_path, "--history", tmp_path, *out)
    assert "give 0 or more" in refused(capsys, tmp_path, tmp_path, "--seed", "-1", *out)
    assert not (tmp_path / "out").exists()


def test_a_file_of_another_schema_is_refused(tmp_path):
    (tmp_path / "comparison.json").write_text('{"schema": "tiago_mj.diagnosis/1"}')
    with pytest.raises(ValueError, match="this version reads"):
        result.KEPT.load(tmp_path / "comparison.json")
    (tmp_path / "comparison.json").write_text('{"schema": "tiago_mj.comparison/1", "kind": 3}')
    with pytest.raises(ValueError, match="is incomplete"):
        result.KEPT.load(tmp_path / "comparison.json")
    with pytest.raises(ValueError, match="no comparison at"):
        result.KEPT.load(tmp_path / "nowhere.json")
