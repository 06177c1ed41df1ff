"""The menu of safe motions: ``tiago-mj record --motion NAME`` plays them, and so can a real robot.

``NAME_RATEhz.csv`` holds ``time`` [s] and ``command.ACTUATOR``; ``NAME_RATEhz.json`` says for which interface and rate.
``python -m tiago_mj.recordings.motions.make`` remakes every file from :mod:`tiago_mj.recordings.motions.menu`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

#: Rates of the files [Hz]: of the real robot's controller, and of the environments.
RATES: Final = (25, 240)
FOLDER: Final = Path(__file__).parent


def file_name(name: str, rate_hz: int) -> str:
    """Name of a motion's file."""
    return f"{name}_{rate_hz}hz.csv"


def find(name: str) -> Path | None:
    """The menu's file of that name, with or without ``.csv``; None if there is none."""
    if Path(name).name != name:
        return None
    path = FOLDER / (name if name.endswith(".csv") else f"{name}.csv")
    return path if path.is_file() else None


def rates(name: str) -> tuple[str, ...]:
    """Files of a motion that was named without its rate, such as ``rest``, without ``.csv``."""
    listed = (FOLDER / file_name(name, rate) for rate in RATES)
    return tuple(path.stem for path in listed if Path(name).name == name and path.is_file())
