"""Every command that an output or a complaint suggests runs as printed; no suggestion of the source is left out."""

from __future__ import annotations

import ast
import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pytest
from printed_lines import ROOT, Printed, Way, clone, environment, of_output, run
from printed_tables import INSTALL, Make, arm, bag, lerobot, recordings, short_training, way_of


@dataclass(frozen=True)
class Output:
    """A command whose output suggests something.

    Attributes:
        name: of the test.
        command: of a shell.
        makes: what it needs.
        status: with which it ends.
        suggests: patterns of what it must suggest.
        files: written by it, whose comments suggest something, too.
    """

    name: str
    command: str
    suggests: tuple[str, ...]
    makes: tuple[Make, ...] = ()
    status: int = 0
    files: tuple[str, ...] = ()


def lacking(module: str, words: str) -> str:
    """A command where a library is not installed."""
    program = f"import sys; sys.modules['{module}'] = None; from tiago_mj.cli import main; sys.exit(main(sys.argv[1:]))"
    return f'python -c "{program}" {words}'


def _robots(folder: Path) -> None:
    (folder / "my arm.urdf").write_bytes((folder / "examples/pendulum/pendulum.urdf").read_bytes())
    arm("arm.xml", folder)


ROLLOUT: Final = "rollout --env GripperTactile-v0 --policy pi --episodes 2"
OUTPUTS: Final = (
    Output(
        "record",
        "tiago-mj record --env GripperTactile-v0 --policy pi --episodes 2 --out 'my logs'",
        ("diagnose 'my logs'",),
    ),
    Output(
        "rollout that is recorded",
        "tiago-mj rollout --env GripperTactile-v0 --policy pi --episodes 2 --record 'my logs'",
        ("diagnose 'my logs'",),
    ),
    Output(
        "record of a model",
        "tiago-mj record --model arm.xml --policy random --episodes 3 --out logs",
        ("diagnose logs",),
        (lambda f: arm("arm.xml", f),),
    ),
    Output(
        "import bag",
        "tiago-mj import bag grasp.bag --out logs",
        ("diagnose logs",),
        (lambda f: bag("grasp.bag", "ros1", f),),
    ),
    Output(
        "import lerobot", "tiago-mj import lerobot cubes --model so101.xml --out logs", ("diagnose logs",), (lerobot,)
    ),
    Output(
        "import lerobot without a model",
        "tiago-mj import lerobot cubes --out logs && cp so101.xml FILE.xml",
        ("diagnose logs --model FILE.xml",),
        (lerobot,),
    ),
    Output("import ta11-curve", "tiago-mj import ta11-curve builtin --out ta11", ("diagnose ta11/A-wood",)),
    Output(
        "convert",
        "tiago-mj convert examples/pendulum/pendulum.urdf --out 'my arm.xml'",
        ("mujoco.viewer --mjcf='my arm.xml'",),
    ),
    Output(
        "train",
        "tiago-mj train --env GripperTactile-v0 --algo td3 --env-option servo=ideal --steps 600 --evaluate-every 600 "
        "--evaluation-episodes 1 --checkpoint-every 600 --quiet --out 'my runs'",
        ("rollout .*--policy 'my runs",),
    ),
    Output(
        "card",
        "sed -n '3s/^ */  /p' runs/card.md",
        ("train .* --out DIR",),
        (lambda f: short_training("--env GripperTactile-v0 --algo td3", "runs", f),),
    ),
    Output("agents", "tiago-mj agents", ("rollout --env",)),
    Output(
        "calibrate-sensor",
        "tiago-mj calibrate-sensor recordings --out 'my cell.yaml'",
        ("sensing=.my cell.yaml",),
        (lambda f: recordings("recordings", f),),
        files=("my cell.yaml",),
    ),
    Output(
        "calibration",
        "tiago-mj diagnose recordings --time-budget 1 --out .",
        ("effects=.calibration.yaml",),
        (lambda f: recordings("recordings", f),),
        files=("calibration.yaml",),
    ),
    Output(
        "stopped",
        "tiago-mj diagnose recordings --time-budget 1 --out 'my answer'",
        (r"^tiago-mj diagnose recordings .*--out 'my answer' --time-budget \d+ --resume$",),
        (lambda f: recordings("recordings", f),),
    ),
    Output("doctor", "tiago-mj doctor", ("-m pip install",)),
    Output(
        "completion",
        "tiago-mj completion --help | tr '\\n' ' ' | tr -s ' '",
        ("mkdir -p .* && tiago-mj completion bash > ",),
    ),
    Output(
        "no URDF",
        "tiago-mj record --model 'my arm.urdf' --policy random --out logs",
        ("convert 'my arm.urdf' --out",),
        (_robots,),
        2,
    ),
    Output("no films", f"{lacking('imageio_ffmpeg', ROLLOUT)} --film a.mp4", ("pip install 'imageio",), (), 2),
    Output("no pandas", lacking("pandas", "diagnose logs --out out"), (r"pip install .*\[gap\]",), (), 2),
    Output(
        "no stable-baselines3",
        lacking("stable_baselines3", "train --env GripperTactile-v0 --out runs"),
        (r"pip install .*\[train\]",),
        (),
        2,
    ),
    Output("no joblib", lacking("joblib", f"{ROLLOUT} --jobs 2"), (r"pip install .*\[scale\]",), (), 2),
    Output("no viser", lacking("viser", "view --env GripperTactile-v0"), (r"pip install .*\[view\]",), (), 2),
    Output(
        "no tensorboard",
        lacking("tensorboard", "train --env GripperTactile-v0 --tensorboard --out runs"),
        (r"pip install .*\[tensorboard\]",),
        (),
        2,
    ),
)


def suggested(one: Output, folder: Path, given: dict[str, str]) -> list[Printed]:
    """What an output suggests."""
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", one.command],
        cwd=folder,
        env=given,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == one.status, done.stderr[-2000:]
    texts = [done.stdout, done.stderr, *((folder / name).read_text(encoding="utf-8") for name in one.files)]
    lines = [line for text in texts for line in of_output(text, one.name)]
    for pattern in one.suggests:
        assert any(re.search(pattern, line.text) for line in lines), f"{pattern}: {[line.text for line in lines]}"
    return list(dict.fromkeys(lines))


@pytest.mark.slow
@pytest.mark.parametrize("one", OUTPUTS, ids=lambda one: one.name)
def test_what_an_output_suggests_runs(one: Output, tmp_path: Path) -> None:
    clone(tmp_path)
    given = environment(tmp_path)
    for make in one.makes:
        make(tmp_path)
    faults = []
    for line in suggested(one, tmp_path, given):
        text = INSTALL.sub("pip install --dry-run --no-deps ", line.text)  # with dependencies: of pages
        way = Way("line", 120) if re.match(r"tiago-mj (diagnose|train) ", text) else way_of(line)
        fault = run(Printed(line.where, line.kind, text), way, tmp_path, given)
        print(f"{'fault' if fault else 'ran'} {line.where}: {line.text}")
        faults += [f"{line.text}: {fault}"] if fault else []
    assert not faults, "\n".join(faults)


#: Literals of the source that name a command and suggest none, or one that a test beside these runs: (file, part of the
#: literal): why.
KNOWN: Final = {
    ("completion.py", "bash: mkdir -p"): "completion",
    ("demo/arm_torque.py", "tiago-mj demo --data recordings"): "needs a download of public recordings",
    ("demo/command.py", "Next: tiago-mj rollout"): "the README's first line, in test_printed_fresh.py",
    ("io/extra.py", ".venv/bin/pip install"): "reports, in test_printed_fresh.py",
    ("io/extra.py", "{} -m pip install"): "no pandas and others",
    ("cli/view.py", "that tiago-mj diagnose wrote"): "names a command",
    ("export/found.py", "tiago-mj diagnose --out wrote"): "names a command",
    ("change/result.py", "tiago-mj compare"): "names a command",
    ("policy_cost/magnitudes.py", "tiago-mj diagnose --out wrote"): "names a command",
    ("rollout/command.py", "next: tiago-mj diagnose"): "rollout that is recorded",
    ("gap/report/commands.py", "from tiago_mj.gap import apply"): "reports, in test_printed_fresh.py",
    ("gap/report/advice.py", "-m mujoco.viewer"): "reports, in test_printed_fresh.py",
    ("gap/report/commands.py", "tiago-mj record"): "reports, in test_printed_fresh.py",
    ("gap/report/commands.py", "tiago-mj train"): "reports, in test_printed_fresh.py",
    ("gap/report/commands.py", "env = gymnasium.make"): "reports, in test_printed_fresh.py",
    ("gap/report/calibration.py", "tiago_mj.gap.apply("): "names a function",
    ("gap/report/json.py", "tiago-mj diagnose"): "names a command",
    ("gap/report/repaired.py", "Made by tiago-mj diagnose"): "names a command",
    ("gap/report/repaired.py", "tiago_mj.gap.apply("): "names a function",
    ("gap/report/verdict.py", "tiago_mj.gap.apply("): "names a function",
    ("robots/known.py", "tiago-mj import lerobot FOLDER"): "names a command",
    ("robots/model.py", "pip install -c constraints.txt"): "needs MuJoCo Menagerie, which its package downloads",
    ("robots/command.py", "motion  tiago-mj robots"): "docs/recordings.md runs it",
    ("cli/options.py", "that tiago-mj robots lists"): "names a command",
    ("randomisation/diagnosis.py", "tiago-mj diagnose"): "names a command",
    ("robots/command.py", "next: tiago-mj robots NAME"): "a form: docs/recordings.md has the commands",
    ("robots/command.py", "--motion is of one robot"): "names a command; docs/recordings.md runs it",
    ("cli/calibrate_sensor.py", "for gymnasium.make(ID"): "help of an option: a form",
    ("sensor_calibration/sheet.py", "tiago-mj calibrate-sensor"): "names a command",
    ("recordings/imports/command.py", "next: tiago-mj diagnose"): "import bag and others",
    ("recordings/imports/lerobot_units.py", "with tiago-mj convert"): "names a command",
    ("recordings/imports/minari.py", "with tiago-mj record"): "names a command",
    ("recordings/record/command.py", "next: tiago-mj diagnose"): "record",
    ("recordings/record/environment.py", "tiago-mj record"): "names a command",
    ("recordings/record/plain.py", "tiago-mj record"): "names a command",
    ("learn/card.py", "tiago-mj train"): "card",
    ("learn/command.py", "next: tiago-mj rollout"): "train",
    ("learn/shipped.py", "tiago-mj rollout"): "agents",
    ("models/build.py", "python -m tiago_mj.models.build"): "the program's own name",
    ("models/convert/command.py", "look at it: {} -m mujoco.viewer"): "convert",
    ("models/files.py", "tiago-mj convert {} --out"): "no URDF",
    ("models/files.py", "then tiago-mj convert"): "needs xacro, which comes with ROS",
    ("models/urdf_source.py", "python -m tiago_mj.models.build"): "run of docs/models.md",
    ("registration.py", "env = gymnasium.make("): "calibrate-sensor, calibration",
    ("sensing/sheet.py", "tiago-mj calibrate-sensor"): "names a command",
    ("view/command.py", "tiago-mj"): "names a command",
    ("view/page.py", "tiago-mj view"): "names a command",
    ("view/recordings.py", "tiago-mj diagnose"): "names a command",
    ("view/server.py", "tiago-mj view"): "names a command",
}
_TELLS: Final = re.compile(
    r"tiago-mj [a-z-]+(?: |$)|pip install|python -m |\{\} -m |gymnasium\.make\(|gap\.apply\(|gap import apply"
)


def literals(path: Path) -> Iterator[str]:
    """Texts of a module that are no docstrings; {} stands for what is put in."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    passed: set[int] = set()
    for node in ast.walk(tree):  # outer ones first
        body = getattr(node, "body", None)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and body and isinstance(body[0], ast.Expr):
            passed.add(id(body[0].value))
        if isinstance(node, ast.JoinedStr):
            passed.update(id(part) for part in ast.walk(node))
            yield "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in passed:
            yield node.value


def test_every_suggestion_of_the_source_is_known() -> None:
    package = ROOT / "tiago_mj"
    found = {
        (path.relative_to(package).as_posix(), text)
        for path in package.rglob("*.py")
        for text in literals(path)
        if _TELLS.search(text)
    }
    unknown = [one for one in found if not any(one[0] == file and part in one[1] for file, part in KNOWN)]
    assert not unknown, "run what these suggest by an Output above, or say in KNOWN why not"
    gone = [known for known in KNOWN if not any(known[0] == file and known[1] in text for file, text in found)]
    assert not gone, "the source says these no more"
