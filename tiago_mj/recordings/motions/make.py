"""Write the menu's files: ``python -m tiago_mj.recordings.motions.make``."""

from __future__ import annotations

import json

import numpy as np

from tiago_mj.io import atomic
from tiago_mj.recordings.motions import FOLDER, RATES, file_name
from tiago_mj.recordings.motions.menu import Item, items

#: Decimals of commands [m, m/s, rad/s] and times [s].
DIGITS = 5


def files() -> dict[str, str]:
    """Contents by file name."""
    out = {}
    for item in items():
        for rate in RATES:
            name = file_name(item.name, rate)
            out[name] = table(item, rate)
            facts = {"interface": item.interface, "rate_hz": rate, "robot": item.robot, "purpose": item.purpose}
            out[name.replace(".csv", ".json")] = json.dumps(facts, ensure_ascii=False) + "\n"
    return out


def table(item: Item, rate_hz: int) -> str:
    """CSV of a motion: a row a control step, the last one at rest.

    A velocity is what leads to the next row's set point from where the rounded ones before have led.
    """
    time = np.arange(int(np.ceil(item.seconds * rate_hz)) + 1) / rate_hz
    columns = []
    for shape in item.shapes.values():
        place = shape(time)
        if item.interface == "position":
            columns.append(np.round(np.append(place[1:], place[-1]), DIGITS))
            continue
        here, sent = float(place[0]), np.zeros(len(time))
        for k in range(len(time) - 1):
            sent[k] = round((float(place[k + 1]) - here) * rate_hz, DIGITS)
            here += sent[k] / rate_hz
        columns.append(sent)
    lines = [",".join(["time", *(f"command.{name}" for name in item.shapes)])]
    lines += [",".join(_short(value) for value in row) for row in np.column_stack([time, *columns])]
    return "\n".join(lines) + "\n"


def _short(value: float) -> str:
    return f"{value + 0.0:.{DIGITS}f}".rstrip("0").rstrip(".")  # no -0


def main() -> None:
    """Write every file, and delete those that are no longer on the menu."""
    made = files()
    for path in FOLDER.glob("*hz.*"):
        if path.name not in made:
            path.unlink()
    for name, content in made.items():
        atomic.write_text(FOLDER / name, content)


if __name__ == "__main__":
    main()
