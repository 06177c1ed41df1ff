"""Effects that are declared to be twins, or to resemble each other, do nearly the same to a hinge or to a grasp."""

import numpy as np
import pytest
from made_hinge import recorded

from tiago_mj.cli import main
from tiago_mj.effects import EFFECTS
from tiago_mj.effects.declare import twins
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference.predictor import predictor
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.read import read_recordings

#: Small magnitudes, as a fit begins with.
MAGNITUDES = {
    "servo_stiffness": {"factor": 1.05},
    "torque_constant": {"factor": 1.05},
    "command_delay": {"seconds": 0.004},
    "command_lag": {"time_constant": 0.004},
    "clock_offset": {"seconds": 0.004},
    "viscous_friction": {"damping": 0.1},
    "servo_damping": {"damping": 0.1},
}
ALIKE = {name: (*twins(name), *EFFECTS[name].resembles) for name in EFFECTS}
PAIRS = sorted({frozenset((name, other)) for name, others in ALIKE.items() for other in others}, key=sorted)


@pytest.fixture(scope="module")
def simulations(tmp_path_factory):
    """Of a hinge that swings, and of a grasp."""
    folder = tmp_path_factory.mktemp("grasp")
    assert (
        main(["record", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", "1", "--out", str(folder)]) == 0
    )
    trials = read_recordings([folder]).trials
    return recorded(tmp_path_factory.mktemp("hinge"))[0], predictor(plant_of(trials), trials, threads=1)[0]


def change(predict, name):
    """How predictions change with an effect, in standard deviations of the noise."""
    entry = Entry(name, None, MAGNITUDES[name])
    nominal, there = predict.all_trials([(), (entry,)], range(len(predict.on.trials)))
    return ((there - nominal) / predict.data.noise).ravel()


def likeness(predict, pair):
    one, other = (change(predict, name) for name in pair)
    return abs(one @ other) / np.sqrt((one @ one) * (other @ other))


@pytest.mark.parametrize("pair", PAIRS, ids=lambda pair: "-".join(sorted(pair)))
def test_twins_change_what_is_measured_alike(simulations, pair):
    assert max(likeness(predict, pair) for predict in simulations) > 0.99


@pytest.mark.parametrize("pair", [("servo_stiffness", "command_delay"), ("servo_damping", "clock_offset")])
def test_what_is_no_twin_changes_it_otherwise(simulations, pair):
    assert max(likeness(predict, pair) for predict in simulations) < 0.95
