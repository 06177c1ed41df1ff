"""Reading and writing recordings, and every unusable one as one clear line."""

import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tiago_mj.io import extra
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.read.tables import MAX_ROWS
from tiago_mj.recordings.recording import RecordingError, Sidecar, Trial, channels
from tiago_mj.recordings.write import write_trial

JOINT = "gripper_right_finger_joint"
FACTS = {"robot": "tiago_mj/GripperTactile-v0", "interface": "velocity", "rate_hz": 100.0}


def columns(rows: int = 60) -> dict[str, np.ndarray]:
    time = np.arange(rows) / 100
    velocity = -0.02 * np.ones(rows)
    return {
        "time": time,
        f"command.{JOINT}": velocity,
        f"position.{JOINT}": 0.045 + velocity * time,
        f"velocity.{JOINT}": velocity + 1e-4 * np.sin(7 * time),
        "force.right": 0.01 * np.sin(np.arange(rows)),
    }


def write_csv(path: Path, table: dict[str, np.ndarray], facts: dict | None = FACTS) -> Path:
    lines = [",".join(table)]
    lines += [",".join("" if np.isnan(v) else repr(float(v)) for v in row) for row in zip(*table.values(), strict=True)]
    path.write_text("\n".join(lines) + "\n")
    if facts is not None:
        path.with_suffix(".json").write_text(json.dumps(facts))
    return path


def refusal(*paths: Path, **options) -> str:
    with pytest.raises(RecordingError) as caught:
        read_recordings(paths, **options)
    line = str(caught.value)
    assert "\n" not in line
    return line


def test_what_is_written_is_read_back_to_the_last_bit(tmp_path):
    t = columns()
    gappy = t["force.right"].copy()
    gappy[::3] = np.nan
    trial = Trial(
        name="grasp-1",
        time=t["time"],
        commands={JOINT: t[f"command.{JOINT}"]},
        positions={JOINT: t[f"position.{JOINT}"]},
        velocities={},
        efforts={JOINT: np.sin(t["time"])},
        forces={"right": gappy},
        sidecar=Sidecar(
            trial="grasp-1",
            robot="tiago_mj/GripperTactile-v0",
            rate_hz=100.0,
            interface="velocity",
            initial={"position": {JOINT: 0.045}},
            raw={"remark": "cold start"},
        ),
        source="grasp-1.parquet",
    )
    path = write_trial(trial, tmp_path / "new")
    (again,) = read_recordings([path]).trials
    assert list(channels(again)) == [f"position.{JOINT}", f"effort.{JOINT}", "force.right"]
    np.testing.assert_array_equal(again.forces["right"], gappy)
    np.testing.assert_array_equal(again.commands[JOINT], trial.commands[JOINT])
    assert again.sidecar.initial == trial.sidecar.initial
    assert again.sidecar.raw["remark"] == "cold start"
    assert pq.read_table(path).column("force.right").null_count == 20


def test_csv_and_parquet_of_the_same_samples_are_the_same_trial(tmp_path):
    t = columns()
    write_csv(tmp_path / "a.csv", t)
    (tmp_path / "b").mkdir()
    pq.write_table(pa.table(t), tmp_path / "b" / "a.parquet")
    (tmp_path / "b" / "a.json").write_text(json.dumps(FACTS))
    one = read_recordings([tmp_path / "a.csv"]).trials[0]
    two = read_recordings([tmp_path / "b"]).trials[0]
    for name in channels(one):
        kind, _, rest = name.partition(".")
        attribute = {"force": "forces", "velocity": "velocities", "position": "positions"}[kind]
        np.testing.assert_array_equal(getattr(one, attribute)[rest], getattr(two, attribute)[rest])


def test_a_clock_that_does_not_start_at_zero_is_shifted_and_said(tmp_path):
    t = columns()
    t["time"] = t["time"] + 1.7e9
    result = read_recordings([write_csv(tmp_path / "a.csv", t)])
    assert result.trials[0].time[0] == 0.0
    assert result.trials[0].time[-1] == pytest.approx(0.59, abs=1e-6)  # 1.7e9 s resolves 0.2 µs
    assert [(f.code, f.repaired) for f in result.findings] == [("time_origin", True)]


@pytest.mark.parametrize(("unit", "factor"), [("us", 1e6), ("ns", 1e9)])
@pytest.mark.parametrize("rate_hz", [100.0, None])
def test_microseconds_and_nanoseconds_become_seconds_and_are_said(tmp_path, unit, factor, rate_hz):
    t = columns()
    t["time"] = (t["time"] + 0.000005) * factor
    facts = {key: value for key, value in {**FACTS, "rate_hz": rate_hz}.items() if value}
    result = read_recordings([write_csv(tmp_path / "a.csv", t, facts)])
    assert result.trials[0].time[-1] == pytest.approx(0.59)
    assert [f.code for f in result.findings] == ["time_unit", "time_origin"]
    assert unit in result.findings[0].message
    assert result.trials[0].sidecar.rate_hz == pytest.approx(100.0)


def test_milliseconds_are_read_where_the_stated_rate_confirms_them_and_refused_otherwise(tmp_path):
    t = columns()
    t["time"] = t["time"] * 1e3
    assert read_recordings([write_csv(tmp_path / "a.csv", t)]).trials[0].time[-1] == pytest.approx(0.59)
    unknown = {key: value for key, value in FACTS.items() if key != "rate_hz"}
    line = refusal(write_csv(tmp_path / "b.csv", t, unknown))
    assert "b.csv" in line
    assert "column time" in line
    assert '"units"' in line
    (tmp_path / "b.json").write_text(json.dumps({**unknown, "units": {"time": "ms"}}))
    assert read_recordings([tmp_path / "b.csv"]).trials[0].time[-1] == pytest.approx(0.59)


def test_stated_units_are_applied_and_said(tmp_path):
    t = columns()
    clean = t[f"position.{JOINT}"].copy()
    t[f"position.{JOINT}"] = clean * 1e3
    path = write_csv(tmp_path / "a.csv", t, {**FACTS, "units": {f"position.{JOINT}": "mm"}})
    result = read_recordings([path])
    np.testing.assert_allclose(result.trials[0].positions[JOINT], clean, rtol=1e-14)
    assert [(f.code, f.repaired) for f in result.findings] == [("unit_scale", True)]


def as_spreadsheets_write(path, table, *, between=";", point=",", mark=True, stated=False):
    """A CSV file as a spreadsheet of half the world saves it."""
    lines = [f"sep={between}"] if stated else []
    lines += [between.join(table)]
    for row in zip(*table.values(), strict=True):
        lines.append(between.join("" if np.isnan(v) else repr(float(v)).replace(".", point) for v in row))
    path.write_bytes((b"\xef\xbb\xbf" if mark else b"") + ("\r\n".join(lines) + "\r\n").encode())
    path.with_suffix(".json").write_text(json.dumps(FACTS))
    return path


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({}, "a byte order mark, semicolons between cells, decimal commas"),
        ({"mark": False, "stated": True}, "semicolons between cells, decimal commas"),
        ({"mark": False, "point": "."}, "semicolons between cells"),
        ({"mark": False, "between": "\t"}, "tabs between cells, decimal commas"),
        ({"between": ",", "point": "."}, "a byte order mark"),
    ],
)
def test_other_csv_files_are_read_as_they_are_meant_and_said_once(tmp_path, options, said):
    t = columns()
    t["force.right"][1::2] = np.nan
    t[f"velocity.{JOINT}"] = 1e-7 * t[f"velocity.{JOINT}"]  # with exponents
    result = read_recordings([as_spreadsheets_write(tmp_path / "a.csv", t, **options)])
    (trial,) = result.trials
    np.testing.assert_array_equal(trial.positions[JOINT], t[f"position.{JOINT}"])
    np.testing.assert_array_equal(trial.velocities[JOINT], t[f"velocity.{JOINT}"])
    assert np.isnan(trial.forces["right"]).sum() == 30
    assert [(f.code, f.repaired, f.message) for f in result.findings] == [
        ("unit_scale", True, f"it has {said}: read as such")
    ]


def test_quoted_decimal_commas_between_commas_and_a_tsv_file_are_read(tmp_path):
    t = columns()
    path = as_spreadsheets_write(tmp_path / "a.csv", t, between='","', mark=False)
    lines = path.read_text().splitlines()
    path.write_text("".join(f'"{line}"\n' for line in lines))
    (trial,) = read_recordings([path]).trials
    np.testing.assert_array_equal(trial.positions[JOINT], t[f"position.{JOINT}"])
    noted = write_csv(tmp_path / "c.csv", t)
    first, *rest = noted.read_text().splitlines()
    noted.write_text("\n".join([f"{first},note", *(f'{line},"1,2"' for line in rest)]) + "\n")
    (trial,) = read_recordings([noted]).trials  # a list of two numbers is no decimal comma
    np.testing.assert_array_equal(trial.positions[JOINT], t[f"position.{JOINT}"])
    path = as_spreadsheets_write(tmp_path / "b.tsv", t, between="\t", point=".", mark=False)
    (trial,) = read_recordings([path]).trials
    np.testing.assert_array_equal(trial.positions[JOINT], t[f"position.{JOINT}"])


def test_a_spreadsheets_file_that_ends_within_a_row_or_mixes_points_is_said(tmp_path):
    path = as_spreadsheets_write(tmp_path / "a.csv", columns())
    path.write_bytes(path.read_bytes()[:-4])
    result = read_recordings([path])
    assert len(result.trials[0].time) == 59
    assert "too_short" in [f.code for f in result.findings]
    path.write_text(path.read_text(encoding="utf-8-sig").replace("0,01;", "0.01;", 1))
    assert "column time: it holds '0.01', not numbers" in refusal(path)


@pytest.mark.parametrize(("unit", "factor"), [("ns", 1e9), ("us", 1e6), ("ms", 1e3), ("s", 1)])
def test_stamps_whose_name_has_their_unit_are_the_time(tmp_path, unit, factor):
    t = columns()
    named = {f"timestamp_{unit}": t.pop("time") * factor + 1.7e9 * factor, **t}
    result = read_recordings([write_csv(tmp_path / "a.csv", named, {**FACTS, "rate_hz": None})])
    np.testing.assert_allclose(result.trials[0].time, np.arange(60) / 100, atol=1e-6)
    assert [f.code for f in result.findings] == ["time_origin", "time_unit"][: 1 + (unit != "s")]


@pytest.mark.parametrize(("column", "mapped"), [("torque_enabled", False), ("motors_on", False), ("estop_ok", True)])
def test_rows_with_the_torque_off_are_left_out_and_cut_a_recording_there(tmp_path, column, mapped):
    t = columns(100)
    on = np.full(100, np.nan)  # said once in a while
    on[[0, 30, 42, 90]] = [1, 0, 1, 0]
    path = write_csv(tmp_path / "a.csv", {**t, column: on})
    options = {}
    if mapped:
        options["map_file"] = tmp_path / "map.yaml"
        options["map_file"].write_text(f"columns:\n  {column}: {{kind: torque_on}}\n")
    result = read_recordings([path], **options)
    assert [trial.name for trial in result.trials] == ["a-01", "a-02"]
    first, second = result.trials
    assert (len(first.time), len(second.time)) == (30, 48)
    assert second.time[0] == 0.0
    assert second.sidecar.initial["position"][JOINT] == t[f"position.{JOINT}"][42]
    assert second.sidecar.initial["velocity"][JOINT] == pytest.approx(-0.02)
    ((code, channel, message),) = [(f.code, f.channel, f.message) for f in result.findings]
    assert (code, channel) == ("time_gap", column)
    assert message.startswith("the torque was off in 22 of 100 rows, first at 0.3 s")
    assert "2 trials" in message
    path.with_suffix(".json").write_text(json.dumps({**FACTS, "object": {"radius_m": 0.02}}))
    result = read_recordings([path], **options)
    assert [trial.name for trial in result.trials] == ["a"]
    assert "how the object stood" in result.findings[0].message


def test_torque_that_was_always_on_says_nothing_and_never_on_is_refused(tmp_path):
    t = columns(60)
    on = np.ones(60)
    result = read_recordings([write_csv(tmp_path / "a.csv", {**t, "torque_on.elbow": on})])
    assert (len(result.trials), result.findings) == (1, ())
    on[20:] = 0
    late = read_recordings([write_csv(tmp_path / "b.csv", {**t, "enabled": on})])
    assert [(trial.name, len(trial.time)) for trial in late.trials] == [("b", 20)]  # nothing was cut: its own name
    assert "never for 20 together" in refusal(write_csv(tmp_path / "c.csv", {**t, "enabled": 0 * on}))
    assert "it reads 3, and whether" in refusal(write_csv(tmp_path / "d.csv", {**t, "enabled": 3 * on}))


def test_a_map_file_names_columns_units_and_signs(tmp_path):
    t = columns()
    renamed = {
        "stamp": t["time"] * 1e6,
        "cmd": t[f"command.{JOINT}"],
        "q": -t[f"position.{JOINT}"] * 1e3,
        "battery": np.full(60, 24.0),
        "unheard_of": np.ones(60),
    }
    path = write_csv(tmp_path / "a.csv", renamed)
    map_file = tmp_path / "map.yaml"
    map_file.write_text(
        f"columns:\n  stamp: {{kind: time, unit: us}}\n  cmd: command.{JOINT}\n"
        f"  q: {{kind: position, name: {JOINT}, unit: mm, scale: -1}}\n  battery: null\n"
    )
    result = read_recordings([path], map_file=map_file)
    np.testing.assert_allclose(result.trials[0].positions[JOINT], t[f"position.{JOINT}"], rtol=1e-14)
    np.testing.assert_allclose(result.trials[0].time, t["time"], atol=1e-12)
    assert ("missing_column", "unheard_of") in [(f.code, f.channel) for f in result.findings]
    assert "battery" not in [f.channel for f in result.findings]


def test_command_line_fallbacks_fill_what_the_sidecar_lacks_and_no_more(tmp_path):
    path = write_csv(tmp_path / "a.csv", columns(), {"rate_hz": 100.0})
    line = refusal(path)
    assert "a.json" in line
    assert "--env" in line
    sidecar = read_recordings([path], defaults={**FACTS, "rate_hz": 7.0}).trials[0].sidecar
    assert (sidecar.robot, sidecar.interface, sidecar.rate_hz) == (FACTS["robot"], "velocity", 100.0)


def test_a_recording_without_sidecar_takes_its_rate_from_its_clock(tmp_path):
    path = write_csv(tmp_path / "a.csv", columns(), None)
    trial = read_recordings([path], defaults={"robot": "arm.xml", "interface": "velocity"}).trials[0]
    assert trial.sidecar.rate_hz == pytest.approx(100.0)
    assert trial.name == "a"


def test_streams_of_different_rates_keep_their_empty_cells(tmp_path):
    t = columns()
    t["force.right"][1::2] = np.nan
    t[f"command.{JOINT}"][-1] = np.nan
    trial = read_recordings([write_csv(tmp_path / "a.csv", t)]).trials[0]
    assert np.isnan(trial.forces["right"]).sum() == 30
    assert np.isnan(trial.commands[JOINT]).sum() == 1


def test_a_copy_of_a_recording_is_used_once(tmp_path):
    write_csv(tmp_path / "a.csv", columns())
    write_csv(tmp_path / "b.csv", columns())
    result = read_recordings([tmp_path])
    assert [trial.name for trial in result.trials] == ["a"]
    assert [(f.code, f.file) for f in result.findings] == [("contradiction", "b.csv")]


def test_trials_named_alike_in_two_folders_are_told_apart(tmp_path):
    for k, folder in enumerate(("monday", "tuesday")):
        (tmp_path / folder).mkdir()
        write_csv(tmp_path / folder / "a.csv", {**columns(), "force.left": np.full(60, float(k))})
    trials = read_recordings([tmp_path / "monday", tmp_path / "tuesday"]).trials
    assert [trial.name for trial in trials] == ["monday-a", "tuesday-a"]


def broken_time(how: str) -> dict[str, np.ndarray]:
    t = columns()
    if how == "unsorted":
        t["time"][[10, 11]] = t["time"][[11, 10]]
    elif how == "duplicated":
        t["time"][20] = t["time"][19]
    elif how == "nan":
        t["time"][7] = np.nan
    elif how == "short":
        t = {name: values[:1] for name, values in t.items()}
    elif how == "empty":
        t = {name: values[:0] for name, values in t.items()}
    return t


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("unsorted", ("column time", "row 12", "sort the rows")),
        ("duplicated", ("column time", "row 21", "delete the duplicated rows")),
        ("nan", ("column time", "row 8", "delete the row")),
        ("short", ("1 row", "at least")),
        ("empty", ("empty", "record again")),
    ],
)
@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_a_clock_that_cannot_be_used_is_refused_with_its_row(tmp_path, how, said, kind):
    t = broken_time(how)
    path = write_csv(tmp_path / "a.csv", t)
    if kind == "parquet":
        path.unlink()
        path = tmp_path / "a.parquet"
        pq.write_table(pa.table(t), path)
    line = refusal(path)
    for words in (path.name, *said):
        assert words in line


@pytest.mark.parametrize("bytes_lost", [1, 3, 100])
def test_a_text_file_that_ends_within_a_row_loses_that_row_and_says_so(tmp_path, bytes_lost):
    path = write_csv(tmp_path / "a.csv", columns())
    path.write_bytes(path.read_bytes()[:-bytes_lost])
    result = read_recordings([path])
    assert len(result.trials[0].time) == (59 if bytes_lost < 80 else 58)
    assert [(f.code, f.repaired) for f in result.findings] == [("too_short", True)]


def test_rows_that_do_not_fit_the_header_are_refused(tmp_path):
    path = write_csv(tmp_path / "a.csv", columns())
    path.write_text(path.read_text().replace("-0.02,", "", 1))
    line = refusal(path)
    assert "does not fit the header's 5 columns" in line


def test_cut_off_and_empty_files_are_refused(tmp_path):
    whole = tmp_path / "b.parquet"
    pq.write_table(pa.table(columns()), whole)
    whole.write_bytes(whole.read_bytes()[:-200])
    assert "cut off" in refusal(whole)
    (tmp_path / "c.csv").write_bytes(b"")
    assert "empty" in refusal(tmp_path / "c.csv")
    (tmp_path / "d.parquet").write_bytes(b"PAR1 no such thing")
    assert "Parquet" in refusal(tmp_path / "d.parquet")


def test_ten_million_rows_are_refused_before_they_are_loaded(tmp_path):
    path = tmp_path / "a.parquet"
    rows = 10_000_000
    time = pa.array(np.arange(rows) / 240)
    pq.write_table(pa.table({"time": time, "force.right": pa.nulls(rows, pa.float64())}), path)
    line = refusal(path, defaults=FACTS)
    assert "10000000 rows" in line
    assert str(MAX_ROWS) in line
    text = tmp_path / "b.csv"
    text.write_bytes(b"time,force.right\n" + b"0,0\n" * (MAX_ROWS + 1))
    assert f"{MAX_ROWS + 1} rows" in refusal(text, defaults=FACTS)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"time": None}, "column time is missing"),
        ({f"command.{JOINT}": None}, "neither command.ACTUATOR nor effort.JOINT"),
        ({f"position.{JOINT}": None, f"velocity.{JOINT}": None, "force.right": None}, "measured motion or force"),
        ({f"position.{JOINT}": np.inf}, f"column position.{JOINT}: row 4 is infinite"),
    ],
)
def test_missing_and_infinite_columns_are_refused_by_name(tmp_path, change, said):
    t = columns()
    for name, value in change.items():
        if value is None:
            del t[name]
        else:
            t[name][3] = value
    assert said in refusal(write_csv(tmp_path / "a.csv", t))


def test_a_column_without_any_value_is_left_out_and_said(tmp_path):
    t = {**columns(), "force.left": np.full(60, np.nan)}
    result = read_recordings([write_csv(tmp_path / "a.csv", t)])
    assert list(result.trials[0].forces) == ["right"]
    assert [(f.code, f.channel) for f in result.findings] == [("empty", "force.left")]


def test_a_recording_of_empty_cells_only_is_refused(tmp_path):
    t = {name: (values if name == "time" else np.full(60, np.nan)) for name, values in columns().items()}
    assert "no column is measured motion or force" in refusal(write_csv(tmp_path / "a.csv", t))


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({**FACTS, "interface": "telepathy"}, "interface"),
        ({**FACTS, "rate_hz": "fast"}, "rate_hz"),
        ({**FACTS, "schema": "tiago_mj.recording/9"}, "schema"),
        ({**FACTS, "initial": {"position": {JOINT: "open"}}}, "initial.position"),
        ({**FACTS, "initial": {"acceleration": {}}}, "initial.acceleration"),
        ({**FACTS, "units": {"position.nose": "mm"}}, "position.nose"),
        ({**FACTS, "units": {f"position.{JOINT}": "furlong"}}, "furlong"),
        ({"robot": "x", "rate_hz": 100}, "interface"),
    ],
)
def test_unusable_sidecars_are_refused_by_field(tmp_path, facts, said):
    assert said in refusal(write_csv(tmp_path / "a.csv", columns(), facts))


def test_files_that_are_no_recordings_are_refused(tmp_path):
    (tmp_path / "a.txt").write_text("x")
    (tmp_path / "void").mkdir()
    path = write_csv(tmp_path / "b.csv", columns())
    path.with_suffix(".json").write_text("{")
    text = write_csv(tmp_path / "c.csv", columns())
    text.write_text(text.read_text().replace("-0.02", "closing", 1))
    headless = tmp_path / "d.csv"
    headless.write_text("0.1,0.2\n0.3,0.4\n")
    for given, said in [
        (tmp_path / "nowhere.csv", "no such file"),
        (tmp_path / "a.txt", "format"),
        (tmp_path / "void", "no recording"),
        (path, "JSON"),
        (text, "'closing'"),
        (headless, "first line"),
    ]:
        assert said in refusal(given)


def test_recordings_of_two_robots_are_refused(tmp_path):
    write_csv(tmp_path / "a.csv", columns())
    write_csv(tmp_path / "b.csv", {**columns(), "force.left": np.ones(60)}, {**FACTS, "robot": "other"})
    assert "several robots" in refusal(tmp_path)


@pytest.mark.parametrize("library", ["pyarrow.csv", "pyarrow.parquet"])
def test_a_missing_library_says_how_to_install_it(tmp_path, monkeypatch, library):
    path = write_csv(tmp_path / "a.csv", columns())
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ModuleNotFoundError, match=re.escape(extra.install("gap"))):
        read_recordings([path])


def test_a_trial_name_that_is_no_file_name_is_refused(tmp_path):
    trial = read_recordings([write_csv(tmp_path / "a.csv", columns())]).trials[0]
    with pytest.raises(ValueError, match="no file name"):
        write_trial(replace(trial, name="../a"), tmp_path)
