"""A diagnosis as files (``diagnosis.json``, ``calibration.yaml``, ``repaired.xml``, the page) and on the terminal."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from tiago_mj.gap import faults
from tiago_mj.gap.report import calibration, html, json
from tiago_mj.gap.report.contradiction import checked
from tiago_mj.gap.result import Diagnosis
from tiago_mj.io import atomic

#: The user's own model with what was found.
REPAIRED: Final = "repaired.xml"
#: The robots, to be watched in a browser.
SCENE: Final = "scene.html"
#: Every file that there may be.
PARTS: Final = (json.NAME, "calibration.yaml", REPAIRED, SCENE, "report.html", faults.FAULT)
#: Finished work of a diagnosis that has not come to its end: for another run that goes on with it.
JOURNAL: Final = "journal.jsonl"


def write(
    diagnosis: Diagnosis, folder: Path, seen: html.Seen | None = None, fault: Exception | None = None
) -> dict[str, Path]:
    """Write all files into ``folder``, which is made where it is missing: all or none; paths by name. A file of an
    earlier diagnosis that this one does not have is removed, and its journal once there is nothing to go on with. A
    fault of drawing the page costs the page alone.

    Args:
        diagnosis: the answer.
        folder: of the files.
        seen: pictures of the robots; None: the report has none.
        fault: of this program, whose traceback is written, too.
    """
    diagnosis = checked(diagnosis)
    page = ""
    try:
        with faults.keeping(lambda met: diagnosis):
            page = html.render(diagnosis, seen)
    except faults.FaultError as met:
        fault = fault or met.fault
    goes_on = diagnosis.stopped is not None and diagnosis.stopped.why != "fault"
    with atomic.replacing_set(folder, parts=PARTS if goes_on else (*PARTS, JOURNAL)) as new:
        json.write(diagnosis, new / json.NAME)
        calibration.write(diagnosis, new / "calibration.yaml", new / json.NAME)
        if diagnosis.repaired is not None and diagnosis.repaired.xml:
            atomic.write_text(new / REPAIRED, diagnosis.repaired.xml)
        if seen is not None and seen.scene:
            atomic.write_text(new / SCENE, seen.scene)
        if page:
            atomic.write_text(new / "report.html", page)
        if fault is not None:
            faults.write(fault, new)
        names = sorted(path.name for path in new.iterdir())
    return {name: folder / name for name in sorted(names, key=PARTS.index)}
