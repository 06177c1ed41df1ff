"""In an environment that holds what the README installs and nothing else: every line of the README, of the reports that
its diagnoses write, and of made-up reports of every kind, as they are printed."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from printed_lines import ROOT, Printed, clone, environment, of_output, of_page, of_report, run
from printed_tables import fixtures, left_out, pendulum, recordings, way_of
from test_printed_pages import in_order

from tiago_mj.demo import arm_torque
from tiago_mj.gap.report import terminal, write
from tiago_mj.gap.report.repaired import with_model
from tiago_mj.gap.result import Diagnosis
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.read import read_recordings

sys.path.insert(0, str(ROOT / "tests" / "gap"))
from made_diagnoses import CASES, COULOMB, TIED, diagnosis, replace

README = ROOT / "README.md"


def fresh(folder: Path) -> dict[str, str]:
    """A clone, and its environment activated: the one that is to be made in it."""
    clone(folder)
    return environment(folder, folder / ".venv" / "bin")


def faults(lines: list[Printed], folder: Path, given: dict[str, str]) -> list[str]:
    """What went wrong with lines that are run one after another."""
    found = []
    for line in dict.fromkeys(lines):
        if left_out(line):
            continue
        since = time.monotonic()
        if "--out trained" in line.text:  # of another report: a training of other settings is not gone on with
            shutil.rmtree(folder / "trained", ignore_errors=True)
        fault = run(line, way_of(line), folder, given)
        print(f"{'fault' if fault else 'ran'} {time.monotonic() - since:4.0f} s  {line.where} {line.text!r}")
        if fault:
            found.append(f"{line.where}: {line.text}\n    {fault}")
    return found


@pytest.mark.slow
def test_every_line_of_the_readme_runs_and_those_of_its_reports(tmp_path: Path) -> None:
    given = fresh(tmp_path)
    for one in fixtures("README.md"):
        one.make(tmp_path)
    lines = in_order(README)
    shown = next(number for number, line in enumerate(lines) if "tiago-mj demo" in line.text) + 1
    others = lines[shown:]
    found = faults(lines[:shown], tmp_path, given)
    said = of_output((tmp_path / ".said").read_text(encoding="utf-8"), "demo")
    suggested = [line for line in said if line.text not in arm_torque.HOW_TO_GET]  # that needs public recordings
    assert suggested
    found += faults([*suggested, *others], tmp_path, given)
    reports = [path for path in sorted(tmp_path.rglob("report.html")) if ".venv" not in path.parts]
    assert len(reports) == 3, "of the demo, the gripper and the pendulum"
    for path in reports:
        name = path.relative_to(tmp_path).as_posix()
        page = path.read_text(encoding="utf-8")
        folder = path.parent if "in the folder of this report" in page else tmp_path
        lines = of_report(page, f"{name}: report")
        found += faults([line for line in lines if "pip install" in line.text], tmp_path, given)
        found += faults([line for line in lines if "pip install" not in line.text], folder, given)
    assert not found, "\n".join(found)


def answers(folder: Path) -> Iterator[tuple[str, Diagnosis]]:
    """A diagnosis of every kind, as their command makes it: of an environment, and of a robot of one's own with
    commands, and with efforts alone."""
    recordings("recordings", folder)
    for name in ("effect", "cut_short", "no_gap", "ambiguous", "unknown", "unknown_with_known", "nothing_compared"):
        out = f"reports/{name}"
        command = f"tiago-mj diagnose recordings --env GripperTactile-v0 --seed 0 --out {out}"
        yield out, replace(CASES[name], robot="GripperTactile-v0", command=command)
    pendulum(folder)
    model, logs = "out/pendulum/pendulum.xml", "out/pendulum/logs"
    mapped = folder / "examples/pendulum/logs.yaml"
    plant = plant_of(read_recordings([folder / logs], map_file=mapped, defaults={"robot": str(folder / model)}).trials)
    elbow = (replace(COULOMB, target=("elbow",)),)
    backlash = replace(TIED[1], effects=(replace(TIED[1].effects[0], name="backlash", target=("elbow",)),))
    for what in ("position", "effort"):
        channels = (f"{what}.shoulder", f"{what}.elbow")
        for kind in ("effect", "no_gap", "ambiguous", "unknown"):
            made = diagnosis(
                kind, elbow if kind in ("effect", "ambiguous") else (), channels=channels, next_motion=None
            )
            if kind == "ambiguous":
                made = replace(made, alternatives=(made.best, backlash))
            out = f"reports/{kind} of {what}"
            given = f"--model {model} --map examples/pendulum/logs.yaml --seed 0 --out '{out}'"
            made = replace(made, robot="pendulum.xml", command=f"tiago-mj diagnose {logs} {given}")
            yield out, with_model(made, plant)


@pytest.mark.slow
def test_every_line_of_a_report_of_every_kind_runs(tmp_path: Path) -> None:
    given = fresh(tmp_path)
    for line in of_page(README)[:2]:  # the environment, and what goes into it
        subprocess.run(["bash", "-ec", line.text], cwd=tmp_path, env=given, check=True)
    has = [tmp_path / ".venv" / "bin" / "python", "-c", "import stable_baselines3"]
    assert subprocess.run(has, env=given, capture_output=True, check=False).returncode, "is of the extra 'train'"
    lines: list[Printed] = []
    for out, found in answers(tmp_path):
        paths = write(found, tmp_path / out)
        lines += of_report(paths["report.html"].read_text(encoding="utf-8"), f"{out}: report")
        lines += of_output("\n".join(line for _, line in terminal.lines(found, {})), f"{out}: terminal")
    lines.sort(key=lambda line: "train" in line.text)  # last what needs more, with its installation before it
    wrong = faults(list({line.text: line for line in lines}.values()), tmp_path, given)
    print(f"{len(lines)} lines, {len({line.text for line in lines})} of them different")
    assert not wrong, "\n".join(wrong)
