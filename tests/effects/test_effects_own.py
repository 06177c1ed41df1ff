"""A user's own effect: the page's block as it stands, in environments and diagnoses; and faulty declarations."""

import json
import re
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from effects_bench import GRIPPER, QUIET, batch_rollout, gripper_actions, make, rollout

from tiago_mj.cli import main
from tiago_mj.effects import EFFECTS, Effect, effect, parameter, read_effects
from tiago_mj.effects.contact import ContactFriction, ContactStiffness
from tiago_mj.effects.fields import known_to
from tiago_mj.effects.force_sensor import ForceGain
from tiago_mj.gap.inference.hypotheses import candidates, terms
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.read import read_recordings

PAGE = Path(__file__).parents[2] / "docs" / "own-effect.md"
STIFFNESS, KP, OPEN = (
    200.0,
    2000.0,
    0.045,
)  # of the page's spring and the finger's servo [N/m]; where fingers start [m]


@pytest.fixture(autouse=True)
def _library():
    """Effects that a test declares are gone after it."""
    before = dict(EFFECTS)
    yield
    EFFECTS.clear()
    EFFECTS.update(before)


def page_block():
    (block,) = re.findall(r"<!-- test: own effect -->\n```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    return block


@pytest.fixture
def page():
    """What the page's block makes."""
    names = {"__name__": "my_effects"}
    exec(page_block(), names)
    return names


# The page's block --------------------------------------------------------------------------------------------------


def test_the_pages_effect_takes_fifteen_lines():
    block = page_block()
    declared = block[block.index("@effect") : block.index("spring =")]
    assert len([line for line in declared.splitlines() if line]) <= 15


def test_the_pages_effect_works_in_an_environment(page):
    env = page["env"]
    env.reset(seed=0)
    for _ in range(240):
        env.step(np.zeros(2))
    rest = env.unwrapped.data.qpos[:2]
    # Servo and spring balance: kp (set point - q) = stiffness · q, on the left finger only; e^-25 of the way is left.
    np.testing.assert_allclose(rest, [OPEN, OPEN * KP / (KP + STIFFNESS)], atol=1e-9)


def test_the_pages_effect_is_absent_at_its_identity_and_the_same_in_a_batch(page):
    del page
    actions = gripper_actions()
    nominal, absent, spring = (
        rollout(effects, actions, sensing=QUIET)
        for effects in (None, {"return_spring": {"stiffness": 0.0}}, {"return_spring": {}})
    )
    np.testing.assert_array_equal(absent.state, nominal.state)
    sims = [{"return_spring": {"stiffness": 0.0}}, {"return_spring": {}}]
    states = batch_rollout(sims, actions, GRIPPER, uniform=np.zeros)[0]
    np.testing.assert_array_equal(states[:, 0], nominal.state)
    np.testing.assert_array_equal(states[:, 1], spring.state)


@pytest.mark.slow
def test_the_pages_effect_is_a_candidate_of_the_diagnosis_and_is_found(page, tmp_path):
    del page
    effects = json.dumps({"return_spring": {"stiffness": 120.0}})
    arguments = ["record", "--env", GRIPPER, "--policy", "pi", "--episodes", "3", "--seed", "0", "--effects", effects]
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    trials = read_recordings([tmp_path]).trials
    assert "return_spring" in {candidate.effect for candidate in candidates(plant_of(trials))}
    found = diagnose(trials, names=("return_spring", "force_gain"), threads=1)
    (named,) = found.best.effects
    assert named.name == "return_spring"
    # The servo's own stiffness is known to 5 % only, 100 N/m: a part of the spring can be laid on it.
    assert named.parameters["stiffness"].value == pytest.approx(120.0, rel=0.15)
    assert named.parameters["stiffness"].unit == "N/m"


def test_a_file_with_the_pages_effect_is_a_command_line_that_knows_it(tmp_path):
    script = tmp_path / "my_effects.py"
    script.write_text(f"{page_block()}\nfrom tiago_mj.cli import main\n\nraise SystemExit(main())\n")
    command = [sys.executable, str(script), "record", "--env", GRIPPER, "--policy", "pi", "--episodes", "1"]
    given = ["--effects", '{"return_spring": {}}', "--out", str(tmp_path / "out")]
    done = subprocess.run([*command, *given], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert list((tmp_path / "out").glob("*.parquet"))


# Declaring -----------------------------------------------------------------------------------------------------------


def test_a_declaration_can_build_on_another(page):
    del page

    @effect("steady_gain", stage="force_sensor", targets="sensor", gap_class="gain")
    class SteadyGain(ForceGain):
        """A gain with an offset."""

        def reading(self, reading, now):
            return super().reading(reading, now) + 0.01 * (self.factor - 1)

    assert list(SteadyGain.parameters) == ["factor"]
    assert (ForceGain.name, SteadyGain.name) == ("force_gain", "steady_gain")
    assert SteadyGain.clause == "", "a report does not call it a gain"
    assert SteadyGain.nominal_prior is None, "the cell's gain is one number of the nominal model"
    r = rollout({"steady_gain": {"factor": 2.0}}, np.zeros((3, 2)), sensing=QUIET)
    np.testing.assert_allclose(r.reading, 0.01)


@pytest.mark.parametrize("hook", ["added_friction", "added_damping", "added_force", "servo_force", "force_range"])
def test_a_hook_that_only_repeats_what_it_overrides_changes_nothing(hook):
    class Repeated(Effect):
        """Says what the base class says."""

        amount = parameter("-", identity=0.0, default=1.0, bounds=(0.0, 2.0))

    def added(self, now):
        return getattr(super(Repeated, self), hook)(now)

    def limits(self, limits, now):
        return super(Repeated, self).force_range(limits, now)

    setattr(Repeated, hook, limits if hook == "force_range" else added)
    effect("repeated", stage="transmission", targets="joint")(Repeated)
    nominal, repeated = (rollout(effects, gripper_actions(), sensing=QUIET) for effects in (None, {"repeated": {}}))
    np.testing.assert_array_equal(repeated.state, nominal.state)


def test_an_own_effect_can_change_masses_and_the_contact_stays_as_it_is_in_newtons_per_metre():
    @effect("heavy_tips", stage="body", targets="object")
    class HeavyTips(Effect):
        """Twice the mass of everything on the fingers."""

        factor = parameter("-", identity=1.0, default=2.0, bounds=(0.5, 4.0))

        def change(self, now):
            now.host.field("body_mass")[:, 2:8] *= self.factor
            now.rebuild = True

    close = np.vstack([np.full((180, 2), -0.5), np.zeros((240, 2))])
    held = [rollout(e, close, object_offset=0.0, sensing=QUIET).force[-1] for e in (None, {"heavy_tips": {}})]
    # At rest only stiffness is felt; the object creeps along by a thousandth.
    assert held[0].min() > 5
    np.testing.assert_allclose(held[1], held[0], rtol=3e-3)


def test_an_own_effect_can_change_the_contact():
    @effect("soft_cover", stage="contact", targets="object")
    class SoftCover(Effect):
        """A cover in series with the pad."""

        stiffness = parameter("N/m", identity=np.inf, default=5000.0, bounds=(500.0, 50_000.0))

        def contact_factors(self, factors, now):
            pad = now.contact[0]
            kept = np.ones_like(self.stiffness)
            return factors / np.hstack([1 + pad / self.stiffness, kept, kept])

    close = np.vstack([np.full((180, 2), -0.5), np.zeros((240, 2))])
    own = rollout({"soft_cover": {"stiffness": 10_000.0}}, close, object_offset=0.0)
    library = rollout({ContactStiffness.name: {"factor": 0.5}}, close, object_offset=0.0)
    np.testing.assert_array_equal(own.state, library.state)


def test_the_same_class_declared_again_takes_the_place_of_the_one_before(page):
    """As when a notebook's cell runs twice."""
    first = page["ReturnSpring"]
    exec(page_block(), again := {"__name__": "my_effects"})
    assert EFFECTS["return_spring"] is again["ReturnSpring"] is not first
    assert [entry.name for entry in read_effects({"return_spring": {}})] == ["return_spring"]


def of(hook="added_force", **parameters):
    """A class with one hook and parameters."""

    def act(self, *arguments):
        return arguments[0]

    hooks = {
        "added_force": lambda self, now: self.amount,
        "reading": lambda self, reading, now: reading,
        "set_point": lambda self, target, now: target,
        "two_arguments": lambda self, reading: reading,
    }
    body = {"__doc__": "One.", "__module__": "elsewhere", "__qualname__": "One", **parameters}
    if hook == "two_arguments":
        body["reading"] = hooks[hook]
    elif hook is not None:
        body[hook] = hooks[hook]
    return type("One", (Effect,), body)


AMOUNT = parameter("N", identity=0.0, default=1.0, bounds=(-2.0, 2.0))
GOOD = {"name": "own", "stage": "transmission", "targets": "joint"}
BAD = {
    "taken": ({"name": "backlash"}, {}, r"'backlash' is already declared, by tiago_mj.*Backlash: choose another name"),
    "no name": ({"name": "My effect"}, {}, r"'My effect': write the name in small letters, digits and underscores"),
    "stage": ({"stage": "motor"}, {}, r"stage 'motor' is unknown: use one of timing, command"),
    "targets": ({"targets": "joints"}, {}, r"targets 'joints' is unknown: use one of command, joint"),
    "no switch": ({}, {"amount": 1.0}, r"0 parameters with an identity: give one to the parameter that switches"),
    "two switches": ({}, {"amount": AMOUNT, "more": AMOUNT}, r"2 parameters with an identity"),
    "taken parameter": ({}, {"stage": AMOUNT}, r"parameter 'stage' has the name of something that every effect has"),
    "hook as parameter": ({}, {"noise": AMOUNT}, r"parameter 'noise' has the name of something that every effect has"),
    "identity": (
        {},
        {"amount": parameter("N", identity=0.5, default=1.0, bounds=(0.1, 2.0))},
        r"'amount' has identity 0.5: use 0 \(an addition\), 1 \(a factor\), inf \(a limit\)",
    ),
    "bounds": (
        {},
        {"amount": parameter("N", identity=0.0, default=3.0, bounds=(0.0, 2.0))},
        r"default 3 and bounds \(0, 2\): give finite bounds, low first, with the default between",
    ),
    "infinite bounds": (
        {},
        {"amount": parameter("N", identity=0.0, default=3.0, bounds=(0.0, np.inf))},
        r"bounds \(0, inf\): give finite bounds",
    ),
    "default": (
        {},
        {"amount": parameter("N", identity=0.0, default=0.0, bounds=(0.0, 2.0))},
        r"has its identity as default",
    ),
    "factor of 0": (
        {},
        {"amount": parameter("-", identity=1.0, default=0.5, bounds=(0.0, 2.0))},
        r"lower bound 0: only what is added may be 0 or negative",
    ),
    "beyond identity": (
        {},
        {"amount": parameter("-", identity=1.0, default=3.0, bounds=(2.0, 4.0))},
        r"bounds \(2, 4\), beyond its identity 1",
    ),
    "relative": (
        {},
        {"amount": parameter("N", identity=0.0, default=1.0, bounds=(0.0, 2.0), nominal="effort")},
        r"nominal='effort': only a limit is a share",
    ),
    "clause of another": (
        {},
        {"amount": AMOUNT, "clause": "{t} {has} {size} of it"},
        r"its clause '\{t\} \{has\} \{size\} of it' has \{size\}: use one of \{amount\}, \{t\}",
    ),
    "less alone": ({}, {"amount": AMOUNT, "clause_less": "{t} lack{s} {amount}"}, r"give both, or the clause alone"),
    "symptom": (
        {},
        {"amount": AMOUNT, "shows_as": "drift"},
        r"shows_as 'drift': use one of grid, noise, repeats",
    ),
    "prior of a limit": (
        {},
        {"amount": AMOUNT, "nominal_prior": known_to(0.04, share_of="limit")},
        r"'own' has a nominal_prior with share_of='limit': of its first parameter use None or 'inertia'",
    ),
    "nothing": ({}, {"hook": None, "amount": AMOUNT}, r"'own' does nothing: give it one of start, change"),
    "unreachable": (
        {"targets": "sensor"},
        {"amount": AMOUNT},
        r"hook added_force, which targets='sensor' cannot reach",
    ),
    "too late": (
        {"stage": "joint_sensor"},
        {"amount": AMOUNT},
        r"in stage 'joint_sensor' it may only measure: use start",
    ),
    "arguments": (
        {"stage": "force_sensor", "targets": "sensor"},
        {"hook": "two_arguments", "amount": AMOUNT},
        r"reading takes 2 arguments, write reading\(self, reading, now\)",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_declaration_that_cannot_work_is_refused_in_one_clear_line(case):
    arguments, body, says = BAD[case]
    before = dict(EFFECTS)
    with pytest.raises(ValueError, match=says) as caught:
        effect(**{**GOOD, **arguments})(of(**body))
    assert "\n" not in str(caught.value)
    assert before == EFFECTS


def test_what_is_no_effect_is_refused():
    with pytest.raises(ValueError, match="'own': declare a class that derives from Effect"):
        effect(**GOOD)(type("One", (), {"amount": AMOUNT}))
    with pytest.raises(ValueError, match=r"give units, defaults and bounds \(low, high\) once, or as a pair of each"):
        parameter("N", identity=0.0, default=1.0, bounds=(0.0, 1.0, 2.0))


@pytest.mark.parametrize("deviation", [-0.1, (0.1, np.inf)])
def test_a_prior_has_a_positive_deviation(deviation):
    with pytest.raises(ValueError, match="give positive deviations"):
        known_to(deviation)


def test_a_number_of_the_nominal_model_that_an_own_effect_changes_is_adjusted_beside_every_explanation(tmp_path):
    @effect("pad_friction", stage="contact", targets="object")
    class PadFriction(ContactFriction):
        """Friction of pads alone."""

        nominal_prior = known_to(0.2)

    assert main(["record", "--env", GRIPPER, "--policy", "pi", "--episodes", "1", "--out", str(tmp_path)]) == 0
    adjusted = terms(plant_of(read_recordings([tmp_path]).trials))
    own = adjusted[-1]
    assert (own.effect, own.parameter, own.deviation) == (PadFriction.name, "factor", 0.2)
    assert [term.effect for term in adjusted].count("contact_friction") == 1


def test_an_effect_of_another_name_is_still_unknown(page):
    del page
    with pytest.raises(ValueError, match=r"'return_sprong' is unknown: did you mean 'return_spring'"):
        gymnasium.make(f"tiago_mj/{GRIPPER}", effects={"return_sprong": {}})
    assert [entry.name for entry in make({"return_spring": {}}).effects] == ["return_spring"]
