"""Which explanation the evidence speaks for."""

from tiago_mj.gap.result import Evidence
from tiago_mj.gap.verdict import Calibration, Option, decide

BY = Calibration(temperature=1.0, stands=0.333, rival=0.05, fails=3.0, remains=3.0)


def option(*names: str, met: float, left: float) -> Option:
    evidence = Evidence(met=met, price=-4.0 * len(names), misfit=min(left, 2.0), lasting=left)
    return Option(frozenset((name, None) for name in names), frozenset(names), evidence)


def test_an_explanation_that_fails_gives_way_to_one_that_stands() -> None:
    """What the second effect does is in few blocks of few samples: 3 nats, less than it costs."""
    nominal = option(met=-200.0, left=17.0)
    alone = option("force_hysteresis", met=-100.0, left=12.0)
    both = option("force_hysteresis", "force_drift", met=-97.0, left=0.5)
    said = decide([alone, both, nominal], BY)
    assert (said.kind, said.rivals[0]) == ("effect", 1)


def test_an_explanation_that_hardly_fails_stays_before_one_that_hardly_stands() -> None:
    nominal = option(met=-200.0, left=17.0)
    alone = option("force_hysteresis", met=-100.0, left=3.1)
    both = option("force_hysteresis", "force_drift", met=-98.0, left=2.9)
    said = decide([alone, both, nominal], BY)
    assert (said.kind, said.rivals[0]) == ("unknown", 0)


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
