"""What stands in for what only a reader has, how far lines are run, and the lines that cannot be run here."""

from __future__ import annotations

import csv
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from printed_lines import ROOT, Printed, Way, blocks, environment

Make = Callable[[Path], None]


def tiago(words: str, folder: Path) -> None:
    """Run a command of this package in a folder."""
    subprocess.run(
        [sys.executable, "-m", "tiago_mj.cli", *shlex.split(words)],
        cwd=folder,
        env=environment(folder),
        check=True,
        capture_output=True,
    )


def recordings(name: str, folder: Path, count: int = 10) -> None:
    """Grasps of a simulated robot with friction that the nominal model lacks."""
    friction = '{"coulomb_friction": {"force": 2.5}}'
    tiago(f"record --env GripperTactile-v0 --policy pi --episodes {count} --effects '{friction}' --out {name}", folder)


def _diagnosis(folder: Path) -> None:
    tiago("diagnose recordings --time-budget 1 --out diagnosis", folder)


def arm(name: str, folder: Path) -> None:
    tiago(f"convert examples/pendulum/pendulum.urdf --out {name}", folder)


def swings(name: str, model: str, folder: Path) -> None:
    tiago(f"record --model {model} --policy random --episodes 4 --out {name}", folder)


def pendulum(folder: Path) -> None:
    """The README's pendulum: its model, its logs and a first answer."""
    make_logs = [sys.executable, "examples/pendulum/make_logs.py", "--out", "out/pendulum/logs"]
    subprocess.run(make_logs, cwd=folder, env=environment(folder), check=True, capture_output=True)
    arm("out/pendulum/pendulum.xml", folder)
    given = "out/pendulum/logs --model out/pendulum/pendulum.xml --map examples/pendulum/logs.yaml"
    tiago(f"diagnose {given} --time-budget 1 --out out/pendulum/diagnosis", folder)


def _elbow(where: str, folder: Path) -> None:
    """An answer of the pendulum: my_robot.xml, and a diagnosis of it."""
    if not (folder / "out" / "pendulum").exists():
        pendulum(folder)
    shutil.copytree(folder / "out" / "pendulum" / "diagnosis", folder / where, dirs_exist_ok=True)


def _block(page: str, number: int, name: str, folder: Path) -> None:
    """A file that the page shows."""
    shown = [text for _, kind, _, text in blocks(ROOT / page) if kind in ("yaml", "json")]
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(shown[number], encoding="utf-8")


def _own_effect(folder: Path) -> None:
    page = ROOT / "docs" / "own-effect.md"
    text = next(text for _, kind, _, text in blocks(page) if kind == "python" and "@effect" in text)
    declared = text.partition("spring = ")[0]
    ending = 'if __name__ == "__main__":\n    from tiago_mj.cli import main\n    raise SystemExit(main())\n'
    (folder / "my_effects.py").write_text(f"{declared}\n{ending}", encoding="utf-8")


def bag(path: str, kind: str, folder: Path) -> None:
    sys.path.insert(0, str(ROOT / "tests" / "gap"))
    import test_bags

    made = test_bags.write_bag(folder / "made", kind, test_bags.grasp((test_bags.RIGHT, test_bags.LEFT)))
    (folder / path).parent.mkdir(exist_ok=True)
    made.rename(folder / path)


def lerobot(folder: Path) -> None:
    sys.path.insert(0, str(ROOT / "tests" / "gap"))
    import test_lerobot

    test_lerobot.dataset(folder / "cubes")
    (folder / "made").mkdir(exist_ok=True)
    test_lerobot.model(folder / "made").rename(folder / "so101.xml")


def _cartpole(folder: Path) -> None:
    sys.path.insert(0, str(ROOT / "tests" / "gap"))
    import numpy as np
    import test_minari

    phase = np.linspace(0, 6, 60)
    seen = np.stack([0 * phase, 0 * phase, 0.1 * np.sin(phase), 0.1 * np.cos(phase)], axis=1)
    store = folder / ".home" / ".minari" / "datasets" / "cartpole" / "mine-v0"
    test_minari.dataset(store, [(seen, np.cos(phase[1:, None]))] * 3)
    (folder / "cartpole.xml").write_text(
        '<mujoco><worldbody><body><joint name="slider" type="slide" axis="1 0 0"/><geom size=".1"/><body>'
        '<joint name="pole" axis="0 1 0"/><geom type="capsule" size=".03" fromto="0 0 0 0 0 .5"/></body></body>'
        '</worldbody><actuator><motor name="slider" joint="slider"/></actuator></mujoco>'
    )


def _curve(name: str, folder: Path) -> None:
    """The published steady forces, from the numbers in the package."""
    from tiago_mj.sensing.ta11_curve import MEASURED

    with (folder / name).open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(["series", "object", "dq_m", "force_sensor_units"])
        for one in MEASURED:
            out.writerows([one.session, one.object, *pair] for pair in zip(one.dq, one.force, strict=True))


def _agent(name: str, of: str, folder: Path) -> None:
    from tiago_mj.learn.shipped import shipped_agents

    shutil.copy2(shipped_agents()[of], folder / name)
    shutil.copy2(shipped_agents()[of].with_suffix(".json"), (folder / name).with_suffix(".json"))


def short_training(words: str, out: str, folder: Path) -> None:
    """A short training in the place of a long one, and of what the long one left when it was stopped."""
    shutil.rmtree(folder / out, ignore_errors=True)
    few = "--steps 600 --evaluate-every 600 --evaluation-episodes 1 --checkpoint-every 600 --quiet"
    tiago(f"train {words} {few} --out {out}", folder)


@dataclass(frozen=True)
class Fixture:
    """What is put in place before a page's lines are run.

    Attributes:
        page: whose lines name it.
        name: as they name it.
        why: who has it.
        make: writes it into the folder in which the lines are run.
        before: found in the first line that needs it, where an earlier line, which is stopped, begins to make it;
            empty: it is there from the start.
    """

    page: str
    name: str
    why: str
    make: Make
    before: str = ""


THEIRS: Final = "the reader's own"
EARLIER: Final = "made on another page, or by a line that takes hours"
FIXTURES: Final = (
    Fixture("docs/environments.md", "recordings", THEIRS, partial(recordings, "recordings")),
    Fixture("docs/own-effect.md", "my_effects.py", "described by the sentence, with the block above it", _own_effect),
    Fixture("docs/own-effect.md", "recordings", THEIRS, partial(recordings, "recordings")),
    Fixture(
        "docs/effects.md", "calibration.yaml", "shown above", partial(_block, "docs/effects.md", 0, "calibration.yaml")
    ),
    Fixture("docs/evaluating.md", "my_agent.npz", THEIRS, partial(_agent, "my_agent.npz", "td3-2021-ideal")),
    Fixture("docs/export.md", "out/pendulum/diagnosis", EARLIER, pendulum),
    Fixture("docs/reading-a-report.md", "recordings", THEIRS, partial(recordings, "recordings", count=3)),
    Fixture("docs/policy-cost.md", "my_robot.xml", THEIRS, partial(arm, "my_robot.xml")),
    Fixture("docs/reading-a-report.md", "my_robot.xml", THEIRS, partial(arm, "my_robot.xml")),
    Fixture("docs/reading-a-report.md", "diagnosis/calibration.yaml", EARLIER, partial(_elbow, "diagnosis")),
    Fixture("docs/reading-a-report.md", "out/diagnosis.json", EARLIER, partial(_elbow, "out")),
    Fixture("docs/recordings.md", "sweep.yaml", "shown below", partial(_block, "docs/recordings.md", 2, "sweep.yaml")),
    Fixture("docs/recordings.md", "arm.xml", THEIRS, partial(arm, "arm.xml")),
    Fixture("docs/recordings.md", "grasp.bag", THEIRS, partial(bag, "grasp.bag", "ros1")),
    Fixture("docs/recordings.md", "my_bag/", THEIRS, partial(bag, "my_bag", "mcap")),
    Fixture(
        "docs/recordings.md", "topics.yaml", "shown below", partial(_block, "docs/recordings.md", 3, "topics.yaml")
    ),
    Fixture("docs/recordings.md", "cubes/", THEIRS, lerobot),
    Fixture(
        "docs/recordings.md", "cartpole.yaml", "shown below", partial(_block, "docs/recordings.md", 4, "cartpole.yaml")
    ),
    Fixture("docs/recordings.md", "cartpole/mine-v0", THEIRS, _cartpole),
    Fixture("docs/recordings.md", "CSV", "public, not committed", partial(_curve, "CSV")),
    Fixture("docs/recordings.md", "payload", THEIRS, partial(swings, "payload", "arm.xml")),
    Fixture("docs/recordings.md", "unloaded/calibration.yaml", EARLIER, partial(_elbow, "unloaded")),
    Fixture(
        "docs/real-data.md",
        "force_vs_displacement.csv",
        "public, not committed",
        partial(_curve, "force_vs_displacement.csv"),
    ),
    Fixture("docs/sensing.md", "recordings", THEIRS, partial(recordings, "recordings")),
    Fixture("docs/sensing.md", "calibration.yaml", EARLIER, partial(_block, "docs/effects.md", 0, "calibration.yaml")),
    Fixture("docs/speed.md", "recordings/*", THEIRS, partial(recordings, "recordings/one", count=3)),
    Fixture("docs/watching.md", "recordings", EARLIER, partial(recordings, "recordings")),
    Fixture("docs/watching.md", "--diagnosis diagnosis", EARLIER, _diagnosis),
    Fixture("docs/watching.md", "out/pendulum/logs", EARLIER, pendulum),
    Fixture(
        "docs/learning.md",
        "runs/paper",
        EARLIER,
        partial(short_training, "--env GripperTactile-v0 --algo td3 --env-option servo=ideal", "runs/paper"),
        before="--policy runs/paper",
    ),
)


@dataclass(frozen=True)
class LeftOut:
    """Lines that are not run here.

    Attributes:
        page: where they stand.
        pattern: that their whole text matches.
        why: what they need that is not here, or who runs them.
    """

    page: str
    pattern: str
    why: str


DATA: Final = "needs public recordings that are not committed; tests/gap/test_imports.py reads them"
HOURS_BEFORE: Final = "needs what the lines before it make in hours or days"
CLUSTER: Final = "needs several machines; tests/scale starts a cluster on one"
FORM: Final = "a form: its capital letters stand for what the reader has"
MENAGERIE: Final = "needs MuJoCo Menagerie, which its package downloads; tests/robots has stand-ins"
ROS: Final = "needs ROS and the robot"
IN_CI: Final = "run by .ci/run as it stands"
ENGINE: Final = "needs the extra blind, with another engine"
FRESH: Final = "installs into the environment: test_printed_fresh.py does, in a fresh one"
COMPARED: Final = "two sets of recordings, searched for minutes; tests/gap/test_compare.py runs the command"
LEFT_OUT: Final = (
    LeftOut("docs/compare.md", r"tiago-mj compare .*", COMPARED),
    LeftOut("README.md", r"python3\.11 -m venv .* -e '\.\[dev\]' .*", IN_CI),
    LeftOut(
        "README.md",
        r"\.venv/bin/python -m docs\.site serve",
        "of an installation for development, as it says; CONTRIBUTING.md's",
    ),
    LeftOut("CONTRIBUTING.md", r"python3\.11 -m venv \.venv", FRESH),
    LeftOut("CONTRIBUTING.md", r"\.venv/bin/(python -m pytest|ruff check) .*", IN_CI),
    LeftOut("docs/index.md", r"python3\.11 -m venv \.venv", FRESH),
    LeftOut("docs/index.md", r"python -m http\.server .*", "serves the site once it is built; tests/docs builds it"),
    LeftOut("docs/install.md", r"uvx .*", "needs uv; tests/test_wheel.py installs the wheel and runs it"),
    LeftOut("docs/another-engine.md", r"python -m benchmarks\.bullet_story .*", ENGINE),
    LeftOut("docs/blind-check.md", r"python -m benchmarks\.blind\.kept write DIR .*", HOURS_BEFORE),
    LeftOut("docs/blind-check.md", r"python -m benchmarks\.blind\.fitters .*", HOURS_BEFORE),
    LeftOut("docs/blind-check.md", r"python -m benchmarks\.calibrate RUN .*", HOURS_BEFORE),
    LeftOut("docs/blind-history.md", r"python -m benchmarks\.varied [A-Z]+ .*", HOURS_BEFORE),
    LeftOut("docs/blind-check.md", r"python -m benchmarks\.blind\.bullet .*", ENGINE),
    LeftOut("docs/evaluating.md", r"python benchmarks/(force_bound|pi_search)\.py.*", "needs the extra blind, for cma"),
    LeftOut(
        "SECURITY.md",
        r".* --require-hashes .*",
        "takes the hashes of the public index, not of a mirror; tests/test_supply.py",
    ),
    LeftOut("docs/tutorials/first-grasp.md", r"tiago-mj rollout .* --film grasp\.mp4", "a film, as of environments.md"),
    LeftOut("docs/tutorials/quadruped-legs.md", r"tiago-mj diagnose logs --robot go2 .*", MENAGERIE),
    LeftOut("docs/recordings.md", r"tiago-mj diagnose logs --robot so101 .*", MENAGERIE),
    LeftOut("docs/recordings.md", r"pip install -c constraints\.txt '\.\[robots\]'", MENAGERIE),
    LeftOut("docs/command-line.md", r"tiago-mj COMMAND --help", FORM),
    LeftOut("docs/command-line.md", r"tiago-mj completion zsh .*", "needs zsh"),
    LeftOut("docs/reading-a-report.md", r"tiago-mj diagnose RECORDING\.\.\. .*", FORM),
    LeftOut("docs/learning.md", r"ray start .*|.*RAY_ADDRESS=.*", CLUSTER),
    LeftOut(
        "docs/learning.md",
        r"import sbx.*",
        "needs sbx, another library that its section is about",
    ),
    LeftOut(
        "docs/learning.md",
        r"python benchmarks/(every_robot|steady|learning|hindsight|near_.*|claims|across_a_gap(_posterior)?)\.py .*",
        HOURS_BEFORE,
    ),
    LeftOut(
        "docs/export.md",
        r"tiago-mj export .* --randomisation .*",
        "needs an answer whose search came to its end; tests/export/test_randomisation.py runs the command",
    ),
    LeftOut("docs/tasks.md", r"import gymnasium\n.*RecordVideo.*", "needs the extra video, as its sentence says"),
    LeftOut("docs/motions.md", r"rosbag .*|import csv.*|python3 play\.py .*", ROS),
    LeftOut(
        "docs/real-data.md", r"python benchmarks/real_data\.py .*|tiago-mj import (tiago-arm|xl330|so101) .*", DATA
    ),
    LeftOut("docs/real-data.md", r"tiago-mj diagnose (arm|xl330) .*|cd joints/Wrist_Pitch\s.*", DATA),
    LeftOut("docs/real-data.md", r"python docs/make_(real|ta11)_picture.*", DATA),
    LeftOut("docs/real-data.md", r"python -m benchmarks\.real .*", "tests/real runs these, or reads what they need"),
    LeftOut("docs/real-data.md", r"tiago-mj diagnose third/A-pringles .*", "of an import that its sentence describes"),
    LeftOut("docs/recordings.md", r"tiago-mj import (tiago-arm|xl330|so101) SRC .*", DATA),
    LeftOut(
        "docs/tutorials/add-an-effect.md", r"python my_effects\.py diagnose .*", "run of own-effect.md, with its effect"
    ),
    LeftOut("docs/speed.md", r"ray start .*|RAY_ADDRESS=.*", CLUSTER),
    LeftOut("docs/speed.md", r"python benchmarks/peers\.py .*", "needs environments of the other simulators"),
)


@dataclass(frozen=True)
class Far:
    """How far lines are run that are not run to their end.

    Attributes:
        pattern: found in their text.
        way: how far.
        why: they are not run to their end.
        pages: whether documents have such lines; else reports and outputs.
    """

    pattern: str
    way: Way
    why: str
    pages: bool = True


HOURS: Final = "takes from minutes to days"
FAR: Final = (
    Far(r"^tiago-mj view (?!.*--save)|docs\.site serve", Way("answer", 400), "serves until it is stopped"),
    Far(r"^marimo edit", Way("answer", 60), "serves until it is stopped"),
    Far(r"mujoco\.viewer", Way("display", 60), "a window, which needs a display", pages=False),
    Far(r"^tiago-mj diagnose .* --out '?reports/", Way("line", 120), "of made-up reports", pages=False),
    Far(r"^tiago-mj diagnose .*--resume", Way("line", 120), "the whole search, after its beginning"),
    Far(r"^tiago-mj train .*--seeds (5|10|3)", Way("line", 120), HOURS),
    Far(r"^tiago-mj train .*--out trained", Way("line", 120), HOURS, pages=False),
    Far(r"^python -m benchmarks\.blind --", Way("line", 120), HOURS),
    Far(r"^python -m benchmarks\.changed_pairs --", Way("line", 120), HOURS),
    Far(r"^python -m benchmarks\.house", Way("line", 60), "counts for seconds"),
    Far(r"^python (-m )?benchmarks[./](?!blind\.kept)", Way("line", 12), HOURS),
    Far(r"^python tests/long/", Way("line", 12), HOURS),
    Far(r"^python docs/make_(engine_pictures|effects_page)", Way("line", 30), "draws what it finds; says nothing"),
    Far(r"--episodes 1000", Way("line", 60), HOURS),
    Far(r"^for series in", Way("line", 120), HOURS),
    Far(r"--policy pi-tuned --bound|--bound$|--bound --film", Way("line", 120), "searches the bound for minutes"),
)
#: Installs are resolved and not made, so that lines after them meet the environment that the page asks for; in a fresh
#: environment they are made.
INSTALL: Final = re.compile(r"pip install ")


def way_of(line: Printed) -> Way:
    """How far a line is run."""
    return next((far.way for far in FAR if re.search(far.pattern, line.text)), Way())


def left_out(line: Printed, table: Sequence[LeftOut] = LEFT_OUT) -> LeftOut | None:
    """The entry of a line that is not run here."""
    one = (entry for entry in table if entry.page == line.page and re.fullmatch(entry.pattern, line.text, re.DOTALL))
    return next(one, None)


def fixtures(page: str) -> list[Fixture]:
    """What the lines of a page need."""
    return [one for one in FIXTURES if one.page == page]
