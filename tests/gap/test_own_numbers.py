"""Numbers of an effect beside its magnitude are fitted with it: a motor behind a spring or a play has an inertia."""

from dataclasses import replace

import numpy as np
import pytest
from made_hinge import recorded

from tiago_mj.effects.fields import usually
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.analysis import outcome
from tiago_mj.gap.inference import hypotheses
from tiago_mj.gap.inference.fit import Fitter, Start
from tiago_mj.gap.inference.points import Point
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.search import step_error
from tiago_mj.gap.search.own_numbers import in_effects
from tiago_mj.gap.simulation.subset import Subset

#: Of the hinge: its inertia is 0.052 kg·m², 2 √(stiffness · inertia) is 2.3 N·m·s/rad.
MOTOR, DAMPING = 0.0026, 0.06
MEASURED = [
    (Entry("joint_elasticity", None, {"stiffness": 30.0, "motor": MOTOR, "damping": DAMPING}), "stiffness"),
    (Entry("backlash", None, {"width": 0.03, "motor": MOTOR}), "width"),
]


@pytest.fixture(scope="module")
def hinge(tmp_path_factory: pytest.TempPathFactory) -> Predictor:
    return recorded(tmp_path_factory.mktemp("hinge"))[0]


def measured_at(predict: Predictor, effect: Entry, factor: float = 1.0) -> Predictor:
    """The same with what a simulator with shorter steps would record with an effect, and noise."""
    finer = replace(predict, plant=replace(predict.plant, max_timestep=predict.plant.max_timestep / factor), off=None)
    value = finer.all_trials([(effect,)], range(len(predict.on.trials)))[0]
    value = value + predict.data.noise * np.random.default_rng(0).standard_normal(value.shape)
    noise = np.broadcast_to(predict.data.noise, value.shape)
    data = replace(predict.data, value=value, sigma=noise, common=np.zeros_like(value))
    return replace(predict, data=data)


def fitter_of(predict: Predictor, terms: tuple[hypotheses.Term, ...] = ()) -> Fitter:
    flat = np.zeros((len(terms), *predict.data.value.shape))
    trials = Subset.of(range(len(predict.data.value)))
    return Fitter(predict, trials, predict.data, np.ones(len(predict.data.channels)), terms, flat)


@pytest.mark.parametrize(("effect", "parameter"), MEASURED, ids=[e.name for e, _ in MEASURED])
def test_the_motor_s_inertia_is_fitted_with_what_connects_it(hinge: Predictor, effect: Entry, parameter: str) -> None:
    predict = replace(measured_at(hinge, effect), corrected=0.0)
    part = hypotheses.candidates(predict.plant, (effect.name,))[0]
    true = effect.parameters[parameter]
    own = hypotheses.own_numbers(predict.plant, (effect.name,))
    assert [term.parameter for term in own] == [name for name in effect.parameters if name != parameter]

    (alone,) = fitter_of(predict).fit_all([Start((part,), np.array([true]))])
    fitter = fitter_of(predict, own)
    at = Point((part,), np.array([true]), np.zeros(len(own)))
    for _ in range(3):
        (fit,) = fitter.linearized_at(at).fit_all([Start(at.parts, at.values, at.nuisance)])
        at = Point.of(fit)
    assert fit.evidence > alone.evidence + 20
    assert abs(fit.values[0] - true) < 3 * fit.deviations[0] < 0.3 * true

    told = in_effects(fit, own)
    assert told.nuisance.size == 0
    for name, value in dict(told.parts[0].fixed).items():
        # Where teeth meet, the step decides: a motor is known to a per cent, whatever the noise says.
        assert abs(value - effect.parameters[name]) < max(4 * told.spreads[name], 0.01 * value), name
        assert outcome.named(predict.plant, told, 0).parameters[name].unit == {"motor": "kg·m²"}.get(name, "N·m·s/rad")
    (same,) = fitter_of(predict).predictions([Point(told.parts, told.values, told.nuisance)])
    np.testing.assert_allclose(same, fitter.predictions([at])[0], atol=1e-9)


def test_a_number_of_an_effect_counts_only_where_the_effect_is(hinge: Predictor) -> None:
    own = hypotheses.own_numbers(hinge.plant, ("joint_elasticity", "coulomb_friction"))
    fitter = fitter_of(hinge, own)
    nothing, friction = (), (hypotheses.candidates(hinge.plant, ("coulomb_friction",))[0],)
    for parts in (nothing, friction):
        values, size = np.full(len(parts), 0.1), len(own)
        moved = fitter.predictions([Point(parts, values, np.full(size, z)) for z in (0.0, 2.0)])
        np.testing.assert_array_equal(moved[0], moved[1])
    assert fitter_of(hinge).effects(friction, np.array([0.1]), np.zeros(0), 0)[0].parameters == {"force": 0.1}


def test_a_detail_s_usual_size_is_declared_in_full() -> None:
    with pytest.raises(ValueError, match="give a positive median"):
        usually(0.1, share_of="mass")
    with pytest.raises(ValueError, match="a factor above 1"):
        usually(0.1, share_of="inertia", within=1.0)


@pytest.mark.parametrize(
    ("factor", "corrected"),
    [(8.0, 7 / 8), (3.0, 2 / 3), (1.0, 0.0)],
    ids=["a finer reality", "a third of the step", "this simulator"],
)
def test_recordings_tell_beside_their_explanation_whether_they_have_the_step_s_error(
    hinge: Predictor, factor: float, corrected: float
) -> None:
    filtered = Entry("velocity_filter", None, {"time_constant": 0.02, "poles": 1.0})
    predict = measured_at(hinge, filtered, factor)
    part = hypotheses.candidates(predict.plant, ("velocity_filter",))[0]
    for begun in (1.0, 0.0):
        fitter = fitter_of(replace(predict, corrected=begun))
        fits = fitter.fit_all([Start((part,), np.array([0.02]))])
        found = step_error.better_step_correction(fitter, fits)
        assert (fitter.predict if found is None else found).corrected == pytest.approx(corrected, abs=0.13)
