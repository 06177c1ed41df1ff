"""What the numbers of a mapped effort are is asked for, and not guessed."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
import yaml

from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import RecordingError

MILLIAMPERES = {"kind": "effort", "name": "elbow", "unit": "mA"}
COUNTS = {"kind": "effort", "name": "elbow", "unit": "counts"}


@pytest.fixture
def read(tmp_path):
    """Reads a log whose column ``drive`` holds an effort as a map says, with commands or without."""
    time = np.arange(0, 4, 0.01)
    columns = {"time": time, "position.elbow": np.sin(time), "drive": 100.0 * np.cos(time)}

    def reading(entry, *, commands=False, units=None):
        held = {**columns, "command.elbow": np.sin(time)} if commands else columns
        rows = "\n".join(",".join(f"{value:.9g}" for value in row) for row in zip(*held.values(), strict=True))
        (tmp_path / "log.csv").write_text(f"{','.join(held)}\n{rows}\n")
        facts = {"robot": "arm.xml", "interface": "position", **({"units": units} if units else {})}
        (tmp_path / "log.json").write_text(json.dumps(facts))
        (tmp_path / "map.yaml").write_text(yaml.safe_dump({"columns": {"drive": entry}}))
        (trial,) = read_recordings([tmp_path / "log.csv"], map_file=tmp_path / "map.yaml").trials
        return float(trial.efforts["elbow"][0])

    return reading


@pytest.mark.parametrize(
    ("entry", "effort"),
    [
        ({**MILLIAMPERES, "torque_constant": 0.0613, "ratio": 336}, 0.1 * 0.0613 * 336),
        ({**MILLIAMPERES, "unit": "A", "torque_constant": -0.087, "ratio": 100}, -100 * 0.087 * 100),
        ({**COUNTS, "scale": 0.01}, 1.0),
        ({**COUNTS, "scale": 2.69e-3, "torque_constant": 0.5, "ratio": 1}, 100 * 2.69e-3 * 0.5),
        ({**MILLIAMPERES, "unit": "Nm"}, 100.0),
        ({"kind": "effort", "name": "elbow", "scale": 0.5}, 50.0),
    ],
)
def test_a_current_or_a_count_becomes_a_torque_by_what_the_map_says_of_motor_and_gear(read, entry, effort):
    assert read(entry) == pytest.approx(effort)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        (MILLIAMPERES, "an effort in mA needs torque_constant"),
        ({**MILLIAMPERES, "torque_constant": 0.06}, "give both"),
        (COUNTS, "an effort in counts needs scale"),
        ({**MILLIAMPERES, "unit": "Nm", "ratio": 100}, "are of an effort in A, mA or counts"),
        ({**MILLIAMPERES, "unit": "Volt"}, "of a drive's A, mA or counts"),
        ("effort.elbow", "column drive: in which unit is this effort? Say so in the map: unit: Nm"),
    ],
)
def test_what_is_missing_is_asked_for_in_one_line(read, entry, said):
    with pytest.raises(RecordingError, match=re.escape(said)) as refused:
        read(entry)
    assert "\n" not in str(refused.value)


def test_the_unit_of_an_effort_is_not_asked_for_where_it_is_told_elsewhere_or_not_compared(read):
    assert read("effort.elbow", units={"effort.elbow": "mNm"}) == pytest.approx(0.1)
    assert read("effort.elbow", commands=True) == pytest.approx(100.0)
