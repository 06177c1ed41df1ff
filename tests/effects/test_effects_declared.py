"""What a declaration says of an effect to those that have to know it: priors, twins, what readings and motions show."""

import pytest

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.checks import SYMPTOMS
from tiago_mj.effects.declare import is_random, only_measures, resembling, twins
from tiago_mj.effects.nominal import ORDER, Seen, known_to_some_percent
from tiago_mj.gap.detectors import readings
from tiago_mj.gap.simulation.sizes import Size

LIBRARY = {name: one for name, one in EFFECTS.items() if one.__module__.startswith("tiago_mj.")}
SIZE = Size(force=2.0, speed=4.0, travel=2.0, inertia=0.1, removable=0.05, mass=0.5)


def test_what_a_nominal_number_is_known_to_is_declared_for_every_place_in_the_order_of_a_fit():
    assert [declared.name for declared in known_to_some_percent(Seen())] == list(ORDER)


@pytest.mark.parametrize("name", LIBRARY)
def test_effects_that_a_declaration_names_are_declared(name):
    declared = LIBRARY[name]
    for other in (*declared.twins, *declared.resembles, *declared.taken_up_by):
        assert other in LIBRARY
        assert other != name
    assert all(name in twins(other) for other in twins(name))
    assert all(LIBRARY[other].gap_class == declared.gap_class for other in twins(name)), "twins are of one class"
    assert all(LIBRARY[other].gap_class != declared.gap_class for other in declared.resembles), "else it is a twin"
    assert all(name in resembling(other) for other in (*twins(name), *declared.resembles))
    assert all(LIBRARY[other].nominal_prior for other in declared.taken_up_by), "else nothing is taken up"


def test_one_effect_loses_commands_and_is_drawn():
    (losing,) = (declared for declared in LIBRARY.values() if declared.loses_commands)
    assert is_random(losing)


def test_what_is_drawn_is_predicted_by_a_mean_but_for_noise():
    assert {name for name, one in LIBRARY.items() if is_random(one)} == {"dropped_commands", "force_dropout"}
    assert LIBRARY["force_noise"].by_chance


def test_sensors_and_their_clock_alone_measure_and_what_moves_the_start_does_not():
    measuring = {name for name, one in LIBRARY.items() if only_measures(one)}
    assert {one.stage for name, one in LIBRARY.items() if name in measuring} == {
        "timing",
        "joint_sensor",
        "force_sensor",
    }
    assert {name for name, one in LIBRARY.items() if one.stage == "force_sensor"} < measuring
    assert measuring.isdisjoint({"encoder_bias", "encoder_scale", "clock_skew"})


def test_the_period_of_a_ripple_is_a_length_or_an_angle():
    (ripple,) = (declared for declared in LIBRARY.values() if declared.ripple_period)
    assert ripple.parameters[ripple.ripple_period].unit == ("m", "rad")


def test_the_frequency_of_a_swing_is_one():
    (swing,) = (declared for declared in LIBRARY.values() if declared.swing_frequency)
    assert swing.parameters[swing.swing_frequency].unit == ("Hz", "Hz")


def test_every_symptom_is_measured_and_shown_by_an_effect():
    assert set(readings.MEASURES) == set(SYMPTOMS) == {one.shows_as for one in LIBRARY.values()} - {""}


def test_what_readings_show_without_changing_their_mean_is_not_fitted():
    shown = {name for name, one in LIBRARY.items() if one.shows_as}
    assert shown - set(readings.only_read_off()) == {"force_bias"}


@pytest.mark.parametrize(
    ("name", "bounds"),
    [
        ("coulomb_friction", (-2.0, 2.0)),
        ("stribeck_friction", (0.0, 2.0)),
        ("viscous_friction", (-1.5, 1.5)),
        ("armature", (-0.05, 3.0)),
        ("payload", (-0.45, 1.5)),
        ("force_limit", None),
        ("joint_elasticity", None),
        ("object_mass", None),
    ],
)
def test_what_is_added_is_sought_as_the_joint_has_it_and_what_is_no_addition_as_the_library_says(name, bounds):
    first = next(iter(LIBRARY[name].parameters.values()))
    library = first.bounds[1]
    assert SIZE.within(first, *library) == pytest.approx(bounds or library)
