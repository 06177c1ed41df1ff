"""Every effect's physical consequence is measured in a rollout: in the files that are named below."""

import test_effect_consequences_commands
import test_effect_consequences_contact
import test_effect_consequences_coupled
import test_effect_consequences_joints
import test_effect_consequences_mount
import test_effect_consequences_sensors
from effects_bench import SHOWN

from tiago_mj.effects import EFFECTS

FILES = (
    test_effect_consequences_commands,
    test_effect_consequences_joints,
    test_effect_consequences_coupled,
    test_effect_consequences_contact,
    test_effect_consequences_sensors,
    test_effect_consequences_mount,
)


def test_every_effect_has_a_test_of_its_consequence_and_every_such_test_is_of_an_effect():
    assert set(SHOWN) == {name for name, declared in EFFECTS.items() if declared.__module__.startswith("tiago_mj.")}
    there = {name for file in FILES for name in vars(file)}
    assert {test for tests in SHOWN.values() for test in tests} <= there
