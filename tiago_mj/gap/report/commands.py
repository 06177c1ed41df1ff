"""Command lines and Python that a report prints, from where its own command was given."""

from __future__ import annotations

import itertools
import json
import shlex
from pathlib import PurePath
from typing import Final

from tiago_mj.gap.result import Diagnosis
from tiago_mj.registration import full_id, import_and_make

#: What makes the environments known.
IMPORTS: Final = "import gymnasium\nimport tiago_mj  # registers the environments\n\n"


def load(diagnosis: Diagnosis) -> str:
    """Python that makes the repaired simulator, in one line, run where the command was given."""
    calibration = beside(diagnosis, "calibration.yaml")
    if not is_model(diagnosis):
        return import_and_make(diagnosis.robot, effects=calibration)
    model = f"mujoco.MjModel.from_xml_path({written(robot(diagnosis))})"
    return f"import mujoco; from tiago_mj.gap import apply; robot = apply({model}, {written(calibration)})"


def make(diagnosis: Diagnosis) -> str:
    """Python that makes the repaired environment, with its imports."""
    effects = written(beside(diagnosis, "calibration.yaml"))
    return f"{IMPORTS}env = gymnasium.make({robot_in_python(diagnosis)}, effects={effects})"


def apply_to_model(diagnosis: Diagnosis) -> str:
    """Python that makes the repaired robot of a model of the user's own, with its imports."""
    model = f"mujoco.MjModel.from_xml_path({written(robot(diagnosis))})"
    return (
        "import mujoco\nfrom tiago_mj.gap import apply\n\n"
        f"robot = apply({model}, {written(beside(diagnosis, 'calibration.yaml'))})"
    )


def record(diagnosis: Diagnosis, motion: str) -> str:
    """The command that records a motion of the menu of a simulated robot."""
    kind = "--model" if is_model(diagnosis) else "--env"
    name = shlex.quote(robot(diagnosis))
    file = motion if motion.endswith(".csv") else f"{motion}_25hz.csv"
    return f"tiago-mj record {kind} {name} --motion {shlex.quote(file)} --episodes 3 --out next"


def train(diagnosis: Diagnosis, effects: str) -> str:
    """The command that trains in the environment with the effects of a file; "": with none."""
    name = shlex.quote(robot(diagnosis))
    return f"tiago-mj train --env {name} {f'--effects {shlex.quote(effects)} ' if effects else ''}--out trained"


def is_model(diagnosis: Diagnosis) -> bool:
    """Whether the simulator is a model of the user's own, and no environment."""
    return diagnosis.repaired is not None or diagnosis.robot.lower().endswith((".xml", ".mjcf"))


def robot(diagnosis: Diagnosis) -> str:
    """As it is named on the command line."""
    return said(diagnosis, "--model") or diagnosis.robot or "ID"


def where_to(diagnosis: Diagnosis) -> str:
    """Where files are found by their names, if that is not where the command was given: a program had none."""
    return "" if diagnosis.command else ", in the folder of this report"


def robot_in_python(diagnosis: Diagnosis) -> str:
    """The environment's id as Python writes it."""
    return written(full_id(diagnosis.robot))


def written(text: str) -> str:
    """A text as Python (and YAML) writes it."""
    return json.dumps(text, ensure_ascii=False)


def beside(diagnosis: Diagnosis, name: str) -> str:
    """A file of this run as it is named from where the command was given."""
    return str(PurePath(said(diagnosis, "--out")) / name)


def said(diagnosis: Diagnosis, option: str) -> str:
    """What the command line gave an option; empty where it did not."""
    try:
        said = shlex.split(diagnosis.command)
    except ValueError:  # of a command line that nobody could run
        return ""
    return next((after for before, after in reversed(list(itertools.pairwise(said))) if before == option), "")


def again(diagnosis: Diagnosis, *more: str) -> str:
    """The command line without a time budget, and with more words; empty where it is not known."""
    try:
        said = shlex.split(diagnosis.command)
    except ValueError:
        return ""
    if not said:
        return ""
    if "--time-budget" in said:
        at = said.index("--time-budget")
        del said[at : at + 2]
    return shlex.join([*said, *more])


def go_on(diagnosis: Diagnosis, budget: int | None) -> str:
    """The command line that goes on with a search that ended early, within another budget [s] or none."""
    return again(diagnosis, *([] if budget is None else ["--time-budget", str(budget)]), "--resume")
