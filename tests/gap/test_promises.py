"""What a verdict promises whichever way it was come by: each promise alone, and all of them on anything at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tiago_mj.gap.analysis import promises
from tiago_mj.gap.analysis.promises import Aside
from tiago_mj.gap.analysis.remainder import LEFT
from tiago_mj.gap.decision.verdict import Calibration, Judged, Option, decide, wrong
from tiago_mj.gap.result import FitQuality

BY = Calibration(temperature=1.0, stands=0.333, rival=0.05, fails=2.17, remains=2.0)
FINE = Aside(closed=0.9, left=1.0, misfit=1.0)


def option(*names: str, met: float = 0.0, left: float = 1.0, edge: bool = False) -> Option:
    evidence = FitQuality(met=met, price=-3.0 * len(names), misfit=left, lasting=left, edge=edge)
    return Option(frozenset((name, None) for name in names), frozenset(names), evidence)


def judged(kind: str, probability: list[float], *rivals: int, remains: bool = False) -> Judged:
    return Judged(kind, np.array(probability), rivals, remains)


# Explanations ---------------------------------------------------------------------------------------------------------


def test_an_effect_that_is_not_likely_is_one_of_a_set_or_unknown() -> None:
    options = [option("armature"), option("viscous_friction"), option()]
    kept = promises.standing(judged("effect", [0.01, 0.85, 0.04], 0), options, BY)
    assert (kept.kind, kept.rivals) == ("ambiguous", (0, 1))
    alone = promises.standing(judged("effect", [0.01, 0.0, 0.8], 0), options, BY)
    assert alone.kind == "unknown"
    assert promises.standing(judged("effect", [0.8, 0.05, 0.05], 0), options, BY).kind == "effect"


def test_a_magnitude_at_its_bound_is_not_named_and_in_no_set() -> None:
    options = [option("payload", edge=True), option("armature"), option("encoder_bias", edge=True), option()]
    probability = [0.5, 0.3, 0.1, 0.0]
    assert promises.standing(judged("effect", probability, 0), options, BY).kind == "unknown"
    kept = promises.standing(judged("ambiguous", [0.3, 0.5, 0.1, 0.0], 1, 0, 2), options, BY)
    assert (kept.kind, kept.rivals) == ("effect", (1,))


@pytest.mark.parametrize(
    ("gains", "fails", "out"),
    [
        ((3.0, 345.0, 60.0), (9.0, 1.0, 5.0), (True, False, True)),
        ((3.0, 345.0, 60.0), (2.0, 1.0, 5.0), (False, False, True)),  # within floor and tolerance: no failure
        ((340.0, 345.0, 300.0), (9.0, 1.0, 9.0), (False, False, True)),  # 340 leaves little more than 345
    ],
)
def test_what_predicts_the_validation_trials_far_worse_is_refuted(
    gains: tuple[float, ...], fails: tuple[float, ...], out: tuple[bool, ...]
) -> None:
    """Gaps of 355 noise floors, in ten blocks that differ by a tenth."""
    random = np.random.default_rng(0)
    samples = np.full(10, 100.0)
    energy = (355.0 - np.array(gains))[:, None] * random.uniform(0.9, 1.1, 10) * samples
    assert tuple(promises.beaten(energy, samples, np.array(fails), BY.fails)) == out


def test_what_one_block_alone_says_refutes_nothing() -> None:
    """One grasp that went another way holds all of the difference: no standard error is so small."""
    energy = np.full((2, 12), 100.0 * 3.0)
    energy[0, 5] = 100.0 * 200
    assert not promises.beaten(energy, np.full(12, 100.0), np.array([20.0, 1.0]), BY.fails).any()
    assert not promises.beaten(energy[:, 5:6], np.full(1, 100.0), np.array([20.0, 1.0]), BY.fails).any()


def test_a_refuted_explanation_does_not_lead_whatever_speaks_for_it() -> None:
    options = [option("armature", met=-10.0), option("viscous_friction", met=-60.0), option(met=-900.0, left=90.0)]
    assert decide(options, BY).rivals[0] == 0
    said = decide(options, BY, refuted=np.array([True, False, False]))
    assert (said.kind, said.rivals) == ("effect", (1,))
    assert said.probability[0] == 0.0
    # What stands on the fitted trials may fail on the others, and the other way round: these count.
    fails = [option("armature", met=-10.0), option("payload", met=-90.0, left=50.0), option(met=-900.0, left=90.0)]
    assert decide(fails, BY, refuted=np.array([True, False, True])).kind == "unknown"


# Trials that were kept aside ------------------------------------------------------------------------------------------

NAMED = [option("armature"), option("payload"), option()]


@pytest.mark.parametrize("kind", ["effect", "ambiguous"])
def test_what_closes_nothing_is_not_named(kind: str) -> None:
    before = judged(kind, [0.6, 0.3, 0.0], 0, 1)
    kept, said = promises.aside(before, replace(FINE, closed=-0.03), NAMED, BY)
    assert (kept.kind, kept.rivals, kept.remains) == ("unknown", (2,), True)
    assert any("closes nothing" in sentence for sentence in said)
    by_chance, said = promises.aside(before, replace(FINE, closed=-0.03, can_close=False), NAMED, BY)
    assert (by_chance.kind, said) == (kind, ())
    no_gap_there, _ = promises.aside(before, replace(FINE, closed=None), NAMED, BY)
    assert no_gap_there.kind == kind


def test_where_there_is_nothing_to_close_there_is_no_gap() -> None:
    """Friction suits the trials that were fitted; without it those kept aside show noise alone (seed 941, case 24)."""
    before, seen = judged("effect", [0.85, 0.0, 0.05], 0), replace(FINE, closed=-0.03, without=0.93)
    kept, said = promises.aside(before, seen, NAMED, BY)
    assert (kept.kind, kept.rivals, kept.remains, said) == ("no_gap", (2,), False, (promises.NOTHING_TO_CLOSE,))
    assert kept.probability[2] == pytest.approx(1 - wrong(0, NAMED[2].evidence, BY.doubt))
    # A grid that the readings lie on is part of every explanation and stays named (seed 71, case 25).
    grid, said = promises.aside(before, seen, NAMED, BY, measured_on_readings=True)
    assert (grid.kind, grid.rivals, grid.remains, said) == ("effect", (2,), False, (promises.NOTHING_BESIDE_READINGS,))
    rival = judged("effect", [0.5, 0.3, 0.05], 0)  # the payload, which may close something, is likelier than nothing
    gap = [option("armature"), option("payload"), option(left=3.0)]
    left, some = replace(seen, without=9.0), replace(seen, without=3.0)
    for odd in ((rival, some, NAMED), (before, seen, gap), (before, left, NAMED)):
        assert promises.aside(*odd, BY)[0].kind == "unknown"
    kept, _ = promises.aside(rival, seen, NAMED, BY)  # where noise alone is left, that can close nothing either
    assert kept.kind == "no_gap"
    assert kept.probability.tolist() == [0.0, 0.0, pytest.approx(1 - wrong(0, NAMED[2].evidence, BY.doubt))]


def test_what_is_left_remains() -> None:
    before = judged("effect", [0.9, 0.0, 0.0], 0)
    kept, _ = promises.aside(before, Aside(closed=0.47, left=55.0, misfit=1.0), NAMED, BY)
    assert (kept.kind, kept.remains) == ("effect", True)
    assert not promises.aside(before, FINE, NAMED, BY)[0].remains


def test_the_larger_part_of_a_gap_is_named_as_a_part() -> None:
    """Real servos leave dozens of variances beside the friction that they have: a user's own model lacks more."""
    options = [option("coulomb_friction", left=60.0), option("payload", left=60.0, edge=True), option(left=900.0)]
    before, seen = judged("unknown", [0.6, 0.1, 0.0], 0, 1), Aside(closed=0.9, left=60.0, misfit=60.0)
    assert promises.aside(before, seen, options, BY)[0].kind == "unknown"
    part = replace(seen, larger_part=True)
    kept, said = promises.aside(before, part, options, BY)
    assert (kept.kind, kept.rivals, kept.remains, said) == ("effect", (0,), True, ())
    at_bound = judged("unknown", [0.1, 0.6, 0.0], 1, 0)
    nothing = judged("unknown", [0.1, 0.1, 0.6], 2)
    unlikely = judged("unknown", [0.3, 0.2, 0.1], 0)
    for other in (at_bound, nothing, unlikely):
        assert promises.aside(other, part, options, BY)[0].kind == "unknown"
    two = [*options[:1], option("payload", left=60.0), options[2]]
    assert promises.aside(judged("unknown", [0.6, 0.3, 0.0], 0, 1), part, two, BY)[0].kind == "ambiguous"


@pytest.mark.parametrize(
    ("low", "left", "misfit", "own_model", "enough"),
    [
        (0.95, 1.2, 1.9, False, True),  # seed 71, case 15: one grasp of seven others slipped another way
        (0.80, 19.0, 8.0, False, False),  # seed 72, case 0: a cable that tugs is no gain
        (0.95, 1.2, 2.5, False, False),
        (0.80, 19.0, 8.0, True, True),
        (0.40, 1.2, 1.0, True, False),
        (None, 1.2, 1.0, True, False),
    ],
)
def test_a_known_model_has_to_be_left_at_noise_where_the_users_own_need_not(low, left, misfit, own_model, enough):
    assert promises.is_larger_part(low, left, misfit, BY, own_model=own_model) is enough


@pytest.mark.parametrize(("sure", "kind"), [(0.4, "unknown"), (0.55, "effect")])
def test_a_part_is_named_only_where_that_is_rather_right_than_wrong(sure: float, kind: str) -> None:
    """What is left says how likely an answer is wrong, though nothing else is as likely."""
    before = replace(judged("unknown", [sure, 0.0, 0.0], 0), sure=sure)
    seen = Aside(closed=0.9, left=60.0, misfit=60.0, larger_part=True)
    options = [option("coulomb_friction", left=60.0), option("payload", left=800.0), option(left=900.0)]
    assert promises.aside(before, seen, options, BY)[0].kind == kind


def test_the_smaller_part_of_a_gap_is_not_named_where_more_than_noise_is_left() -> None:
    """A spring that stiffens is no bias of an encoder, though that closes some of it (seed 3737, cases 33 and 77)."""
    before, seen = judged("effect", [0.9, 0.0, 0.0], 0), Aside(closed=0.42, left=8.1, misfit=1.0, smaller_part=True)
    kept, said = promises.aside(before, seen, NAMED, BY)
    assert (kept.kind, kept.rivals, kept.remains, said) == ("unknown", (0,), True, (promises.SMALLER_PART,))
    assert promises.aside(before, replace(seen, can_close=False), NAMED, BY)[0].kind == "effect"
    assert promises.aside(judged("no_gap", [0.0, 0.0, 0.9], 2), seen, NAMED, BY)[0].kind == "no_gap"


def test_there_is_no_no_gap_where_the_trials_kept_aside_have_one() -> None:
    before = judged("no_gap", [0.0, 0.0, 0.9], 2)
    kept, said = promises.aside(before, Aside(closed=None, left=55.0, misfit=9.0), NAMED, BY)
    assert (kept.kind, kept.remains, len(said)) == ("unknown", True, 1)
    assert promises.aside(before, Aside(closed=None, left=55.0, misfit=1.0), NAMED, BY)[0].kind == "no_gap"


def test_numbers_that_fit_small_motions_and_spoil_large_ones_are_told() -> None:
    samples = np.full(10, 100.0)
    stated, fitted = samples * 12.0, samples * 44.0
    (said,) = promises.spoiled(fitted, stated, samples, ["encoder_scale of hinge 0.947"], ["0.4 rad against 1.2 rad"])
    assert "encoder_scale of hinge 0.947" in said
    assert "44" in said
    assert "12" in said
    assert "0.4 rad against 1.2 rad" in said
    assert promises.spoiled(stated, fitted, samples, ["encoder_scale of hinge 0.947"], []) == ()
    assert promises.spoiled(1.1 * stated, stated, samples, ["encoder_scale of hinge 0.947"], []) == ()
    assert promises.spoiled(fitted, stated, samples, [], []) == ()


# Anything at all ------------------------------------------------------------------------------------------------------

EFFECTS = ("armature", "payload", "encoder_bias", "force_gain", "backlash")


def anything(random: np.random.Generator) -> tuple[list[Option], Judged, Aside]:
    """Explanations and a verdict that need not fit each other, and whatever the trials kept aside show."""
    options = [option(met=float(random.normal(-50, 40)), left=float(random.lognormal(0.5, 1.5)))]
    for _ in range(int(random.integers(1, 7))):
        names = random.choice(EFFECTS, size=int(random.integers(1, 4)), replace=False)
        met, left = float(random.normal(-40, 40)), float(random.lognormal(0.0, 1.5))
        options.append(option(*names, met=met, left=left, edge=bool(random.random() < 0.3)))
    if random.random() < 0.5:
        verdict = decide(options, BY)
    else:
        share = random.dirichlet(np.full(len(options), 0.3)) * 0.9
        order = tuple(int(k) for k in random.permutation(len(options))[: int(random.integers(1, len(options) + 1))])
        kind = str(random.choice(["effect", "ambiguous", "unknown", "no_gap"]))
        if kind in ("effect", "ambiguous"):
            order = tuple(k for k in order if options[k].effects) or (1,)
        if kind == "no_gap":
            order = (0,)
        verdict = Judged(kind, share, order, bool(random.random() < 0.5), sure=0.9)
    closed = None if random.random() < 0.2 else float(random.normal(0.4, 0.5))
    seen = Aside(
        closed,
        float(random.lognormal(1, 2)),
        float(random.lognormal(0, 1)),
        bool(random.random() < 0.9),
        without=None if random.random() < 0.3 else float(random.lognormal(1, 1)),
        larger_part=closed is not None and closed > promises.LARGER_PART,
    )
    return options, verdict, seen


@pytest.mark.parametrize("seed", range(300))
def test_whatever_was_found_the_promises_are_kept(seed: int) -> None:
    options, verdict, seen = anything(np.random.default_rng(seed))
    kept, said = promises.aside(promises.standing(verdict, options, BY), seen, options, BY)
    best = options[kept.rivals[0]]
    classes = {options[k].classes for k in kept.rivals}
    assert kept.kind in ("no_gap", "effect", "ambiguous", "unknown")
    if kept.kind in ("effect", "ambiguous"):
        assert best.effects
        assert not any(options[k].evidence.edge for k in kept.rivals)
        assert not (seen.can_close and seen.closed is not None and seen.closed <= promises.CLOSES)
        assert kept.remains or (seen.left <= LEFT and seen.misfit <= BY.remains)
        assert (len(classes) > 1) == (kept.kind == "ambiguous")
    if kept.kind == "effect":
        assert kept.probability[kept.rivals[0]] >= promises.MIN_NAMED_PROBABILITY * kept.sure
        others = [kept.probability[k] for k, one in enumerate(options) if one.classes != best.classes]
        assert verdict.probability is kept.probability
        assert all(p <= kept.probability[kept.rivals[0]] + 1e-12 for p in others)
    if kept.kind == "no_gap":
        assert not best.effects
        assert not kept.remains
        if promises.NOTHING_TO_CLOSE in said:
            assert seen.without is not None
            assert seen.without <= LEFT
            assert kept.probability[kept.rivals[0]] >= kept.probability.max() > 0
        else:
            assert seen.left <= LEFT or seen.misfit <= BY.fails
    if said:
        assert kept.kind == ("no_gap" if promises.NOTHING_TO_CLOSE in said else "unknown")
        assert kept.kind != verdict.kind
    again, nothing_more = promises.aside(promises.standing(kept, options, BY), seen, options, BY)
    assert (again.kind, again.rivals, again.remains, nothing_more) == (kept.kind, kept.rivals, kept.remains, ())
