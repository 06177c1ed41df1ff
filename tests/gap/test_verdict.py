"""Which explanation the evidence speaks for."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tiago_mj.gap.decision.verdict import (
    Calibration,
    Doubt,
    Option,
    calibration,
    decide,
    measured_on,
    wrong,
)
from tiago_mj.gap.inference.hypotheses import FORM_COMPENSATION, Candidate
from tiago_mj.gap.result import FitQuality
from tiago_mj.gap.search import ranking
from tiago_mj.io.quantities import NINETY

BY = Calibration(temperature=1.0, stands=0.333, rival=0.05, fails=3.0, remains=3.0)


def option(*names: str, met: float, left: float, edge: bool = False) -> Option:
    evidence = FitQuality(met=met, price=-4.0 * len(names), misfit=min(left, 2.0), lasting=left, edge=edge)
    return Option(frozenset((name, None) for name in names), frozenset(names), evidence)


@pytest.mark.parametrize(
    ("alone_leaves", "both_leave", "said"),
    [(12.0, 0.5, ("effect", 1)), (3.1, 2.9, ("unknown", 0))],
    ids=["fails where another stands", "hardly fails where another hardly stands"],
)
def test_an_explanation_gives_way_to_a_less_likely_one_only_where_it_leaves_much_more(
    alone_leaves: float, both_leave: float, said: tuple[str, int]
) -> None:
    """What the second effect does is in few blocks of few samples: 3 nats, less than it costs."""
    nominal = option(met=-200.0, left=17.0)
    alone = option("force_hysteresis", met=-100.0, left=alone_leaves)
    both = option("force_hysteresis", "force_drift", met=-97.0, left=both_leave)
    decision = decide([alone, both, nominal], BY)
    assert (decision.kind, decision.rivals[0]) == said


def test_where_everything_fails_it_is_unknown_and_the_least_bad_goes_first() -> None:
    nominal = option(met=-200.0, left=90.0)
    said = decide(
        [option("force_gain", met=-150.0, left=20.0), option("force_bias", met=-110.0, left=9.0), nominal], BY
    )
    assert (said.kind, said.rivals[0]) == ("unknown", 1)


def test_nothing_is_named_that_hardly_stands_where_the_nominal_model_hardly_fails() -> None:
    nominal, play = option(met=-100.0, left=3.1), option("backlash", met=-101.0, left=2.95)
    said = decide([nominal, play], BY)
    assert (said.kind, said.rivals) == ("unknown", (0,))


def test_where_everything_fails_the_likelier_nominal_model_goes_first() -> None:
    nominal, inertia = option(met=-100.0, left=8.1), option("armature", met=-99.0, left=8.0)
    said = decide([inertia, nominal], BY)
    assert (said.kind, said.rivals) == ("unknown", (1,))


def test_what_has_to_be_as_large_as_an_effect_can_be_stands_for_something_else() -> None:
    """A spring that stiffens was met by a base that leans by all of 0.5 rad, a scale and an offset."""
    nominal = option(met=-900.0, left=400.0)
    leaning = option("gravity_tilt", "encoder_bias", "encoder_scale", met=-100.0, left=1.1, edge=True)
    said = decide([leaning, nominal], BY)
    assert (said.kind, said.rivals[0]) == ("unknown", 0)


def test_a_magnitude_is_at_its_bound_unless_the_effect_vanishes_there() -> None:
    tilt = Candidate("gravity_tilt", None, "angle", (), 0.0, -0.5, 0.5, (), "rad")
    assert [tilt.at_edge(x) for x in (-0.5, 0.0, 0.4999, 0.49)] == [True, False, True, False]
    limit = Candidate("force_limit", None, "limit", (), math.inf, 1.0, 16.0, (), "N")
    assert [limit.at_edge(x) for x in (1.0, 5.0, 16.0)] == [True, False, False]
    friction = Candidate("coulomb_friction", None, "force", (), 0.0, -2.0, 8.0, (), "N", removes=True)
    assert [friction.at_edge(x) for x in (-2.0, 0.0, 8.0)] == [False, False, True]
    play = Candidate("backlash", None, "width", (), 0.0, 0.0, 0.01, (), "m")
    assert [play.at_edge(x) for x in (0.0, 0.01)] == [False, True]


def test_even_the_surest_answer_leaves_a_share_to_what_is_none_of_them() -> None:
    nominal, gain = option(met=-900.0, left=40.0), option("force_gain", met=-100.0, left=0.9)
    said = decide([gain, nominal], replace(BY, doubt=Doubt(named=float(np.log(0.04 / 0.96)))))
    assert said.kind == "effect"
    assert said.probability.sum() == pytest.approx(0.96)


def test_what_suits_one_trial_and_harms_others_is_not_named() -> None:
    nominal, gain = option(met=-200.0, left=1.0), option("force_gain", met=-100.0, left=0.9)

    def agreeing(agreement: float) -> Option:
        return replace(gain, evidence=replace(gain.evidence, agreement=agreement))

    said = [decide([agreeing(one), nominal], BY) for one in (1.0, 0.77)]
    assert [(one.kind, one.rivals) for one in said] == [("effect", (0,)), ("no_gap", (1,))]


def test_what_one_effect_leaves_is_not_taken_for_another() -> None:
    """An encoder is off; where a finger slows down, some 30 nats are left of what it changes."""
    nominal, one = option(met=-9000.0, left=400.0), option("encoder_bias", met=-130.0, left=0.6)
    both = option("encoder_bias", "joint_elasticity", met=-100.0, left=0.6)
    assert decide([both, one, nominal], BY).rivals[0] == 0
    assert decide([both, one, nominal], replace(BY, further=10.0)).rivals[0] == 1
    large = option("encoder_bias", "joint_elasticity", met=-30.0, left=0.6)
    assert decide([large, one, nominal], replace(BY, further=10.0)).rivals == (0,)
    # Beside what the readings betray, which every explanation holds, one effect is another one already.
    grid, beside = option(met=-130.0, left=0.9), option("coupling_error", met=-100.0, left=0.9)
    options, less = [beside, grid], replace(BY, further=10.0)
    assert [decide(options, less, measured_on_readings=yes).rivals[0] for yes in (False, True)] == [0, 1]


def test_of_two_pairs_the_one_that_meets_the_recordings_better_is_ahead_though_its_parts_alone_do_worse() -> None:
    """A dead band alone looks much like friction and a delay together; neither of these does by itself."""
    nominal, band = option(met=-9000.0, left=400.0), option("command_deadband", met=-1100.0, left=20.0)
    friction = option("coulomb_friction", met=-2700.0, left=10.0)
    delay = option("command_delay", met=-4200.0, left=90.0)
    wrong = option("command_deadband", "command_delay", met=-620.0, left=1.9)
    right = option("coulomb_friction", "command_delay", met=-170.0, left=0.3)
    said = decide([right, wrong, band, friction, delay, nominal], replace(BY, further=2.0))
    assert said.rivals == (0,)


def test_of_three_effects_each_counts_for_less_beside_the_two_before() -> None:
    nominal = option(met=-9000.0, left=400.0)
    one = option("rate_limit", met=-300.0, left=90.0)
    two = option("rate_limit", "viscous_friction", met=-100.0, left=0.6)
    three = option("rate_limit", "viscous_friction", "dropped_commands", met=-90.0, left=0.6)
    assert decide([three, two, one, nominal], BY).rivals[0] == 0
    assert decide([three, two, one, nominal], replace(BY, further=5.0)).rivals[0] == 1


def test_a_magnitude_is_known_no_better_than_the_form_of_its_effect() -> None:
    """What its nominal number is uncertain by is none of its own uncertainty: recordings show the sum of both."""
    late = Candidate("command_delay", None, "seconds", (), 0.0, 0.0, 0.2, (), "s", tolerance=0.002)
    assert late.known_to(0.0) == 0.0
    assert late.known_to(0.1) == pytest.approx(FORM_COMPENSATION * 0.001)  # of 1 %, which is a delay's
    heavier = Candidate("object_mass", None, "factor", (), 1.0, 0.2, 5.0, (), "-", tolerance=0.12)
    assert heavier.known_to(2.0) == pytest.approx(FORM_COMPENSATION * 0.03)
    slow = Candidate("velocity_limit", None, "velocity", (), math.inf, 0.1, 2.0, (), "m/s")
    assert slow.known_to(0.5) == 0.0


def test_no_effect_is_named_whose_own_interval_holds_none_of_it():
    assert pytest.approx(NINETY * calibration().widens, abs=0.01) == ranking.least_deviations(replays=True)


def test_another_effect_is_sought_wherever_the_verdict_says_that_a_gap_remains():
    assert calibration().remains == ranking.REMAINING_DISCREPANCY


def test_answers_along_a_motion_are_doubted_by_cases_of_their_own():
    met = FitQuality(met=0.0, price=0.0, misfit=1.0, lasting=0.5)
    replayed, along = (calibration(replays=replays).doubt for replays in (True, False))
    assert wrong(0, met, along) > wrong(0, met, replayed)
    assert measured_on("doubt", replays=False) != measured_on("doubt")
    assert measured_on("temperature", replays=False) == measured_on("temperature")
