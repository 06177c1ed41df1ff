"""A recording of a gripper that rubs, what a diagnosis says of it, and a browser."""

import shutil

import pytest
from made_answers import answer

from tiago_mj.cli import main
from tiago_mj.effects import read_effects
from tiago_mj.gap.report import calibration, json

CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
#: OpenGL of Mesa, in software.
FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=gl-egl", "--ignore-gpu-blocklist")


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """Two grasps of a gripper whose fingers rub with 2.5 N."""
    folder = tmp_path_factory.mktemp("recorded") / "rec"
    effects = '{"coulomb_friction": {"force": 2.5}}'
    what = ["--env", "GripperTactile-v0", "--policy", "pi", "--episodes", "2", "--effects", effects]
    assert main(["record", *what, "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="session")
def diagnosed(tmp_path_factory):
    """The folder of a diagnosis that names that friction."""
    folder = tmp_path_factory.mktemp("diagnosed")
    json.write(answer(), folder / "diagnosis.json")
    calibration.write(answer(), folder / "calibration.yaml", folder / "diagnosis.json")
    assert read_effects(str(folder / "calibration.yaml"))[0].parameters == {"force": 2.5}
    return folder


@pytest.fixture(scope="session")
def known(recorded, diagnosed):
    from tiago_mj.view.recordings import library

    return library([recorded], folder=diagnosed)


@pytest.fixture
def page():
    """A page of a headless Chromium; skips where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = next((found for name in CHROMIUM if (found := shutil.which(name))), None)
    if path is None:
        pytest.skip("no Chromium here (Debian: chromium)")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=path, args=list(FLAGS))
        opened = browser.new_page(viewport={"width": 900, "height": 520})
        opened.set_default_timeout(90_000)
        faults = []
        opened.on("pageerror", lambda fault: faults.append(str(fault)))
        opened.on("console", lambda said: "Content Security" in said.text and faults.append(said.text))
        yield opened
        browser.close()
    assert [fault for fault in faults if fault not in getattr(opened, "expected", ())] == []
