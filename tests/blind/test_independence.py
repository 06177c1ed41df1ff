"""Reality shares no code with the diagnosis, and agrees with the nominal simulator where nothing differs."""

import ast
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import tiago_mj  # noqa: F401  (registers the environments)
from benchmarks.blind import cases, recordings, robots

BLIND = Path(__file__).resolve().parents[2] / "benchmarks" / "blind"


#: What stands on the diagnosis' own declarations and code.
ITS_CODE = ("tiago_mj.gap", "tiago_mj.effects")


def imported(path: Path) -> set[str]:
    """Every module that a file imports, wherever in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name} imports relatively"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            assert not node.value.startswith(ITS_CODE), f"{path.name} names {node.value}"
    return found


def test_the_blind_check_imports_nothing_of_the_diagnosis() -> None:
    files = list(BLIND.rglob("*.py"))
    assert len(files) > 10
    for path in files:
        wrong = [name for name in imported(path) if name.startswith(ITS_CODE) or name == "tiago_mj.*"]
        assert not wrong, f"{path.name} imports {wrong}"


def test_an_import_of_the_diagnosis_would_be_found(tmp_path: Path) -> None:
    for line in ("from tiago_mj.gap import replay", "def f():\n    import tiago_mj.effects.spec"):
        (tmp_path / "bad.py").write_text(line)
        assert any(name.startswith(ITS_CODE) for name in imported(tmp_path / "bad.py"))


@pytest.mark.parametrize(
    ("interface", "rate"),
    [*(pytest.param(one, 25.0, marks=pytest.mark.slow) for one in ("velocity", "position")), ("velocity", 240.0)],
)
def test_without_effect_and_jitter_reality_is_the_environment_up_to_the_integrator(interface: str, rate: float) -> None:
    case = cases.Case(seed=3, interface=interface, rate=rate, spread=0.0, placement=0.0, trials=3, seconds=6.0)
    made = cases.simulate(case)
    env = gymnasium.make(
        "tiago_mj/GripperTactileGoal-v0", control=interface, control_hz=rate, object_offset=0.0
    ).unwrapped
    for k in range(3):
        env.reset(seed=0)
        position, force = [env.state.position], [env.state.force_contact]
        for command in made.recorded.commands[k, :-1]:
            action = command / env.velocity_limit
            if interface == "position":
                low, high = env.model.jnt_range[:2].T
                action = (command - low) / (high - low) * 2 - 1
            env.step(np.clip(action, -1, 1))
            position.append(env.state.position)
            force.append(env.state.force_contact)
        # Another step, integrator and contact: less than the encoder's noise (27 µm) in position, and in force than
        # 0.02 sensor units (0.12 N; the noise is 0.0077), which the few rows around a contact's onset decide.
        error = made.recorded.position[k] - position
        assert np.sqrt(np.mean(error**2)) < np.hypot(robots.FINGER_NOISE[0], 1e-5)
        blocks = np.array_split(error, int(case.seconds * 4))
        # What lasts for a quarter of a second is no more than noise leaves in means of six rows (4 deviations).
        assert max(np.abs(block.mean(axis=0)).max() for block in blocks) < 4 * robots.FINGER_NOISE[0] / np.sqrt(6)
        short = made.recorded.force[k] - np.array(force) * robots.UNITS_PER_NEWTON
        assert np.sqrt(np.mean(short**2)) < 0.025
        assert np.max(force) > 2.0, "the trial presses on the object"
    env.close()


def test_a_case_is_the_same_whenever_it_is_made() -> None:
    rng = np.random.default_rng(5)
    case = cases.Case(seed=5, effects=(cases.choose("gripper", "coulomb_friction", rng),), trials=1, seconds=1.5)
    first, second = cases.simulate(case).recorded, cases.simulate(case).recorded
    assert np.array_equal(first.position, second.position)
    assert np.array_equal(first.force, second.force)
    assert np.array_equal(first.commands, second.commands, equal_nan=True)


def test_recordings_hold_nothing_of_the_truth(tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    choice = cases.EffectChoice("object_size", "all", {"radius": 0.003})
    made = cases.simulate(cases.Case(seed=6, effects=(choice,), trials=1, seconds=1.0))
    recordings.write(made, tmp_path)
    written = sorted(path.name for path in tmp_path.iterdir())
    assert written == ["trial-00.json", "trial-00.parquet"]
    text = (tmp_path / "trial-00.json").read_text()
    assert '"radius_m": 0.02' in text, "the user believes in the nominal object"
    for secret in ("object_size", "effect", "seed", "truth", "jitter", str(made.robot.item.mass)):
        assert secret not in text
    assert pq.read_schema(tmp_path / "trial-00.parquet").metadata is None
