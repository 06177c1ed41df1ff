"""Recordings that a user may well have: each ends in one line that says what to mend, or in a verdict that says it."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import tiago_mj  # noqa: F401  (registers the environments)
from tiago_mj.cli import main
from tiago_mj.effects import EFFECTS
from tiago_mj.models import names

RIGHT, LEFT = names.FINGERS
#: All but a few effects, so that a verdict takes a second.
FEW = ",".join(name for name in EFFECTS if name not in ("coulomb_friction", "force_gain", "command_delay"))


@pytest.fixture(scope="module")
def squeezes(tmp_path_factory):
    """Tables and sidecars of three recordings without a gap, by trial."""
    folder = tmp_path_factory.mktemp("squeezes")
    call = ["record", "--env", "GripperTactile-v0", "--motion", "squeeze_medium_25hz", "--episodes", "3"]
    assert main([*call, "--out", str(folder)]) == 0
    return {
        path.stem: (pd.read_parquet(path), json.loads(path.with_suffix(".json").read_text()))
        for path in sorted(folder.glob("*.parquet"))
    }


@pytest.fixture
def diagnosed(squeezes, tmp_path, capsys):
    """Diagnose the squeezes after a change; exit status, what was said on stderr, and the diagnosis if there is one."""

    def run(change=None, *options, first_only=False, trials=3, form="parquet", damage=None):
        folder, out = tmp_path / "recordings", tmp_path / "out"
        folder.mkdir()
        for number, (stem, (table, facts)) in enumerate(list(squeezes.items())[:trials]):
            facts = json.loads(json.dumps(facts))
            if change is not None and not (first_only and number):
                table, facts = change(table.copy(), facts)
            path = folder / f"{stem}.{form}"
            table.to_parquet(path, index=False) if form == "parquet" else table.to_csv(path, index=False)
            if facts is not None:
                path.with_suffix(".json").write_text(json.dumps(facts))
            if damage is not None and not number:
                damage(path)
        capsys.readouterr()
        call = ["diagnose", str(folder), "--out", str(out), "--jobs", "2", "--time-budget", "0.1", "--without", FEW]
        status = main([*call, *options])
        said = re.sub(r"^diagnose: .*(so far|left)\n", "", capsys.readouterr().err, flags=re.MULTILINE)  # progress
        written = out / "diagnosis.json"
        if status:
            assert not out.exists()
        return status, said, json.loads(written.read_text()) if written.exists() else None

    return run


def columns(kind, values):
    """A change: the columns of a kind, (name, values) to values."""
    return lambda table, facts: (
        table.assign(**{c: values(c, table[c]) for c in table.columns if c.startswith(kind)}),
        facts,
    )


def rows(which):
    return lambda table, facts: (which(table), facts)


def said(**changes):
    return lambda table, facts: (table, {**facts, **changes})


def renamed(*pairs):
    return lambda table, facts: (table.rename(columns=dict(pairs)), facts)


def both(*pairs):
    """Two columns under each other's name."""
    return renamed(*pairs, *((b, a) for a, b in pairs))


def spoiled(column, row, value):
    def change(table, facts):
        table.loc[row, column] = value
        return table, facts

    return change


REFUSED = {
    "empty": (rows(lambda t: t.iloc[:0]), "it has a header but no row"),
    "one sample": (rows(lambda t: t.iloc[:1]), "1 row is too short"),
    "unsorted": (rows(lambda t: t.sample(frac=1.0, random_state=0)), "column time: goes back at row"),
    "duplicated rows": (rows(lambda t: t.loc[t.index.repeat(2)]), "delete the duplicated rows"),
    "appended to itself": (rows(lambda t: pd.concat([t, t])), "column time: goes back at row 63"),
    "all empty": (columns(("c", "p", "v", "e", "f"), lambda c, v: np.nan * v), "no column is measured motion"),
    "nothing measured": (columns(("p", "v", "e", "f"), lambda c, v: np.nan * v), "no column is measured motion"),
    "stamps missing": (spoiled("time", 3, np.nan), "column time: row 4 is empty"),
    "infinite": (spoiled(f"position.{RIGHT}", 9, np.inf), f"column position.{RIGHT}: row 10 is infinite"),
    "a wild reading": (spoiled(f"position.{RIGHT}", 9, 1e6), f"column position.{RIGHT}: row 10 reads 1e+06"),
    "an absurd reading": (spoiled("force.left", 9, -1e300), "column force.left: row 10 reads -1e+300"),
    "text": (columns(f"position.{LEFT}", lambda c, v: "open"), f"column position.{LEFT}: it holds 'open'"),
    "frozen": (columns(("p", "v", "f"), lambda c, v: v.iloc[0]), "no usable channel is left"),
    "millimetres": (columns(("position", "velocity"), lambda c, v: 1e3 * v), '"mm"'),
    "commands in millimetres": (columns("command", lambda c, v: 1e3 * v), '"mm/s"'),
    "time in milliseconds at no stated rate": (
        lambda t, s: (t.assign(time=1e3 * t["time"]), {**s, "rate_hz": None}),
        "time",
    ),
    "flipped": (columns(f"command.{RIGHT}", lambda c, v: -v), f"column command.{RIGHT}: the joint moves against it"),
    "swapped fingers": (both((f"position.{RIGHT}", f"position.{LEFT}")), "are exchanged: each follows the other joint"),
    "every other row": (rows(lambda t: t.iloc[::2]), "states rate_hz 25, the rows come at 12.5 Hz"),
    "another rate": (said(rate_hz=240), "states rate_hz 240, the rows come at 25 Hz"),
    "another interface": (said(interface="effort"), "is 'effort', but the joint follows it as a velocity"),
    "no interface": (said(interface="telepathy"), "interface in the sidecar is 'telepathy'"),
    "no robot": (said(robot="PR2"), "robot 'PR2' is neither an environment"),
    "no sidecar": (lambda t, s: (t, None), "which robot is recorded is unknown"),
    "another schema": (said(schema="other/9"), "schema is 'other/9'"),
    "object in millimetres": (said(object={"radius_m": 20}), "object.radius_m in the sidecar is 20"),
    "object of no size": (said(object={"radius_m": "wide"}), "object.radius_m in the sidecar is 'wide'"),
    "no load cell": (said(sensing={"scale": "x"}), "sensing.scale in the sidecar is 'x'"),
    "unknown unit": (said(units={"position": "furlong"}), "unit 'furlong' of a position is unknown"),
    "a start in millimetres": (said(initial={"position": {RIGHT: 45.0}}), "is 45, the first row has 0.045"),
    "unknown actuator": (renamed((f"command.{RIGHT}", "command.thumb")), "no actuator 'thumb'"),
    "one more joint": (
        lambda t, s: (t.assign(**{"position.thumb": t[f"position.{RIGHT}"]}), s),
        "no joint 'thumb', it has",
    ),
    "a mistyped joint": (
        renamed((f"velocity.{RIGHT}", "velocity.gripper_rihgt_finger_joint")),
        f"no joint 'gripper_rihgt_finger_joint': did you mean {RIGHT!r}?",
    ),
    "a mistyped load cell": (renamed(("force.right", "force.rigth")), "no load cell 'rigth': did you mean 'right'?"),
    "a mistyped kind": (renamed(("force.right", "forces.right")), "did you mean 'force.right'?"),
    "unknown joints": (
        lambda t, s: (t.rename(columns=lambda c: re.sub(r"^(pos|vel|eff)(.*)gripper_", r"\1\2hand_", c)), s),
        "no joint 'hand_right_finger_joint'",
    ),
}  # fmt: skip


#: What concerns all recordings alike.
TOGETHER = ("another interface", "no robot")


@pytest.mark.parametrize(
    ("name", "first_only"),
    [(name, False) for name in REFUSED] + [(name, True) for name in REFUSED if name not in TOGETHER],
)
def test_what_cannot_be_used_ends_in_one_line_that_names_the_file_and_leaves_nothing(diagnosed, name, first_only):
    change, message = REFUSED[name]
    status, line, _ = diagnosed(change, first_only=first_only)
    assert status == 2, line
    assert line.count("\n") == 1
    assert line.startswith("tiago-mj diagnose: squeeze_medium_25hz-000.")
    assert message in line


@pytest.mark.parametrize(
    ("damage", "form", "message"),
    [
        (lambda path: path.write_bytes(path.read_bytes()[:-400]), "parquet", "not a whole Parquet file"),
        (lambda path: path.write_bytes(b""), "csv", "the file is empty"),
        (lambda path: path.write_bytes(bytes(range(256)) * 9), "csv", "not UTF-8 text"),
        (lambda path: path.write_text(path.read_text().replace(",", "|")), "csv", "time is missing"),
        (lambda path: path.write_text(path.read_text() + "1,2\n"), "csv", "does not fit the header"),
        (lambda path: path.with_suffix(".json").write_text('{"robot": '), "parquet", "not readable JSON"),
        (lambda path: path.with_suffix(".json").write_text("[1]"), "parquet", "no JSON object"),
        (lambda path: path.with_suffix(".json").write_text('{"rate_hz": NaN}'), "parquet", "rate_hz in the sidecar"),
    ],
)
def test_damaged_files_end_in_one_line(diagnosed, damage, form, message):
    status, line, _ = diagnosed(damage=damage, form=form)
    assert (status, line.count("\n")) == (2, 1), line
    assert "squeeze_medium_25hz-000." in line
    assert message in line


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--model", "none.xml"], "none.xml"),
        (["--env", "Nope-v0"], "'Nope-v0' is neither an environment"),
        (["--map", "none.yaml"], "none.yaml"),
        (["--time-budget", "-3"], "--time-budget is -3"),
        (["--seed", "-1"], "--seed is -1"),
        (["--without", "gremlins"], "--without gremlins"),
    ],
    ids=str,
)
def test_unusable_options_end_in_one_line(diagnosed, options, message):
    status, line, _ = diagnosed(None, *options)
    assert (status, line.count("\n")) == (2, 1), line
    assert message in line


def test_a_model_without_the_named_joint_is_refused_by_name(diagnosed, tmp_path):
    model = tmp_path / "arm.xml"
    model.write_text("<mujoco><worldbody><body><joint name='hinge'/><geom size='.1'/></body></worldbody></mujoco>")
    status, line, _ = diagnosed(None, "--model", str(model))
    assert (status, line.count("\n")) == (2, 1)
    assert "has no joint 'gripper_right_finger_joint', it has hinge" in line


def found(diagnosis):
    return {(finding["code"], finding["channel"]) for finding in diagnosis["lint"]}


def test_a_lone_recording_that_was_cut_off_gets_a_verdict_without_a_closed_share(diagnosed):
    cut = lambda path: path.write_bytes(path.read_bytes()[:-60])  # noqa: E731
    status, line, diagnosis = diagnosed(trials=1, form="csv", damage=cut)
    assert (status, line) == (0, "")
    assert {("single_trial", ""), ("too_short", "")} <= found(diagnosis)
    assert diagnosis["splits"]["test"] == []
    assert diagnosis["shrink"]["closed"] is None


def test_channels_that_cannot_be_believed_are_said_and_left_out(diagnosed):
    def change(table, facts):
        table["force.left"] = 0.25  # a cable came off
        table[f"velocity.{LEFT}"] = np.nan
        table.loc[1::2, "force.right"] = np.nan  # a slower sensor
        return table, {**facts, "object": {**facts["object"], "shape": "mug"}}

    only = ",".join(name for name in EFFECTS if name != "force_gain")
    status, line, diagnosis = diagnosed(change, "--time-budget", "100", "--without", only, trials=2)
    assert (status, line) == (0, "")
    lint = found(diagnosis)
    assert ("dead_channel", "force.left") in lint
    assert {("empty", f"velocity.{LEFT}"), ("contradiction", "")} <= lint
    compared = {row["channel"] for row in diagnosis["where"]}
    assert compared
    assert not compared & {"force.left", f"velocity.{LEFT}"}


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="Linux says how much memory a process took")
def test_ten_million_rows_are_refused_quickly_in_little_memory(tmp_path):
    count = 10_000_000
    time = pa.array(np.arange(count) / 240)
    empty = pa.nulls(count, pa.float64())
    pq.write_table(
        pa.table({"time": time, f"command.{RIGHT}": empty, f"position.{RIGHT}": empty}), tmp_path / "a.parquet"
    )
    # The process says itself how much memory it took [KiB]; ru_maxrss would be that of the process that it began as.
    program = (
        "import sys; from tiago_mj.cli import main; status = main(sys.argv[1:]); "
        "print(next(l.split()[1] for l in open('/proc/self/status') if l.startswith('VmHWM'))); sys.exit(status)"
    )
    call = [sys.executable, "-c", program, "diagnose", str(tmp_path), "--out", str(tmp_path / "out")]
    done = subprocess.run(call, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "a.parquet: 10000000 rows" in done.stderr
    assert "cut it into trials" in done.stderr
    # Reading them whole would take 240 MB more for each column.
    assert int(done.stdout.split()[-1]) < 600_000


def test_what_is_too_long_to_replay_is_refused_with_what_to_do(diagnosed):
    def repeated(table, facts):
        many = pd.concat([table] * 40, ignore_index=True)
        return many.assign(time=np.arange(len(many)) / 25), facts

    status, line, _ = diagnosed(repeated)
    assert status == 2
    assert "99 s in 2480 rows are too long" in line
    assert "one motion a file" in line


def test_an_output_folder_that_is_a_file_is_said_before_it_takes_time(tmp_path, capsys):
    taken = tmp_path / "taken"
    taken.write_text("mine")
    with pytest.raises(SystemExit) as ended:
        main(["diagnose", str(tmp_path), "--out", str(taken)])
    line = capsys.readouterr().err
    assert (ended.value.code, line.count("\n")) == (2, 1)
    assert "taken" in line
    assert taken.read_text() == "mine"
