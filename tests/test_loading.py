"""Files that users bring, and worse ones: whatever stands in them, there is one line, soon, and in little memory."""

import json
import os
import random
import resource
import sys
import time
import zlib
from pathlib import Path

import numpy as np
import pytest
from hostile_files import HOSTILE_JSON, HOSTILE_YAML, READERS, VALUES, mutated, scrambled

from tiago_mj.io.loading import MAX_DEPTH, MAX_VALUES, load_json, load_yaml
from tiago_mj.io.quoting import HIDDEN, QUOTED, is_number, one_line, quoted
from tiago_mj.io.schema import Open, SchemaError, checked

#: Of any reader, on any file, as docs/trust.md promises: a bomb took minutes and gigabytes. The dearest file takes less
#: than a second of a free processor, and several of one that other programs use, too.
SECONDS, MEGABYTES = 20.0, 300.0
MUTATIONS = 300
every_reader = pytest.mark.parametrize("name", READERS)


@pytest.fixture(scope="module", autouse=True)
def libraries(tmp_path_factory):
    """What readers import is not what files cost."""
    for name, reader in READERS.items():
        reader.read(reader.place(tmp_path_factory.mktemp(name), reader.text(reader.content)))


def peak():
    """Most memory of this process so far [MB]."""
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / 1e6 if sys.platform == "darwin" else most / 1e3


def outcome(reader, path):
    """The complaint of a file, of which everything is checked that a user counts on; empty where it is accepted."""
    before, began = peak(), time.process_time()
    said, kind = "", reader.error
    try:
        reader.read(path)
    except Exception as fault:
        said, kind = str(fault) or "nothing", type(fault)
    assert kind is reader.error, f"{kind.__name__}: {said[:500]}"
    if said:
        assert len(said.splitlines()) == 1
        assert HIDDEN.search(said) is None
        assert len(said) < 2500
    assert time.process_time() - began < SECONDS
    assert peak() - before < MEGABYTES
    return said


@every_reader
def test_what_is_valid_is_accepted(name, tmp_path):
    reader = READERS[name]
    assert outcome(reader, reader.place(tmp_path, reader.text(reader.content))) == ""


HOSTILE = [
    (name, case)
    for name, reader in READERS.items()
    for case in (HOSTILE_JSON if reader.is_json else HOSTILE_YAML)
    if (name, case) not in (("additions", "nothing"), ("effects", "nothing"))  # there need not be any
]


@pytest.mark.parametrize(("name", "case"), HOSTILE, ids=[": ".join(pair) for pair in HOSTILE])
def test_a_hostile_file_is_refused_in_one_line(name, case, tmp_path):
    reader = READERS[name]
    content = (HOSTILE_JSON if reader.is_json else HOSTILE_YAML)[case]
    assert outcome(reader, reader.place(tmp_path, content))


@every_reader
def test_whatever_is_changed_in_a_valid_file_it_is_accepted_or_refused_in_one_line(name, tmp_path):
    reader = READERS[name]
    rng = random.Random(zlib.crc32(name.encode()))
    refused = 0
    for _ in range(MUTATIONS):
        content = mutated(reader.content, rng)
        try:
            refused += outcome(reader, reader.place(tmp_path, reader.text(content))) != ""
        except AssertionError as fault:
            raise AssertionError(f"{fault} of {quoted(json.dumps(content), 2000)}") from fault
    assert MUTATIONS / 10 < refused < MUTATIONS


@every_reader
def test_whatever_bytes_are_changed_in_a_valid_file_it_is_accepted_or_refused_in_one_line(name, tmp_path):
    reader = READERS[name]
    rng = random.Random(zlib.crc32(name.encode()) + 1)
    valid = reader.text(reader.content).encode()
    refused = 0
    for _ in range(MUTATIONS):
        content = scrambled(valid, rng)
        try:
            refused += outcome(reader, reader.place(tmp_path, content)) != ""
        except AssertionError as fault:
            raise AssertionError(f"{fault} of {content!r}") from fault
    assert MUTATIONS / 4 < refused < MUTATIONS


# What the readers share


def written(tmp_path, text, suffix="yaml"):
    path = tmp_path / f"file.{suffix}"
    path.write_text(text, encoding="utf-8")
    return path


def test_yaml_is_read_as_before_but_for_keys_and_dates(tmp_path):
    text = (
        "&base base: {a: 1, b: [1.5, -2, 0x1f, 1_000, 1:30, .inf, true, off, ~, '3', 1.0e+3, 1e3]}\n"
        "more: {<<: {a: 1, c: 2}, a: 3}\non: 1\n1: one\nwhen: 2026-01-15\nagain: &x [1]\nsame: *x\ntext: |\n  a\n  b\n"
    )
    found = load_yaml(written(tmp_path, text), "file")
    assert found == {
        "base": {"a": 1, "b": [1.5, -2, 31, 1000, 90, float("inf"), True, False, None, "3", 1000.0, "1e3"]},
        "more": {"a": 3, "c": 2},
        "on": 1,
        "1": "one",
        "when": "2026-01-15",
        "again": [1],
        "same": [1],
        "text": "a\nb\n",
    }


def test_the_earlier_of_two_merged_mappings_wins_and_its_own_keys_before_both(tmp_path):
    text = "a: &a {x: 1, y: 1}\nb: &b {x: 2, z: 2}\nc: {<<: [*a, *b], y: 3}\n"
    assert load_yaml(written(tmp_path, text), "file")["c"] == {"x": 1, "y": 3, "z": 2}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\nb: [1, 2\nc: 3\n", "line 3: "),
        ("a: 1\nb:\n  c: 1\n  c: 2\n", "line 4: the key 'c' is there twice"),
        ("a: 1\nb: *c\n", "line 2: *c names nothing before it"),
        ("a: 1\nb: 1.0e+999\n", "line 2: the number 1.0e+999 is too large"),
        ("a: 1\nb: !new 3\n", "line 2: the tag '!new' is not read"),
        ("a: 1\n\nb: \tc\u202e\n", "line 3: 'c\\u202e' holds the character U+202E, which is not shown"),
        ("a:\n" + "".join(f"{'  ' * k}a:\n" for k in range(1, 40)), f"nested more than {MAX_DEPTH} deep"),
    ],
)
def test_a_fault_of_yaml_is_said_with_its_line_and_how_to_mend_it(text, said, tmp_path):
    with pytest.raises(ValueError, match=r"^joints\.yaml is no YAML \(.*\): mend the file$") as caught:
        load_yaml(written(tmp_path, text), "joints.yaml is no YAML")
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"a": 1,\n"b" 2}', "line 2: "),
        ('{"a": 1,\n"b": 1e999}', "line 2: the number 1e999 is too large"),
        ('{"a": 1,\n"b": 99999999999999999999}', "line 2: the number 99999999999999999999 is too large"),
        ("[" * 40 + "]" * 40, f"nested more than {MAX_DEPTH} deep"),
        ("[" + "1," * MAX_VALUES * 2 + "1]", f"more than {MAX_VALUES} values"),
    ],
)
def test_a_fault_of_json_is_said_with_its_line(text, said, tmp_path):
    with pytest.raises(ValueError, match=r"^a\.json is no JSON \(.*\): mend the file$") as caught:
        load_json(written(tmp_path, text, "json"), "a.json is no JSON")
    assert said in str(caught.value)


def test_a_byte_order_mark_is_no_fault(tmp_path):
    for load, text in ((load_json, '\ufeff{"a": 1}'), (load_yaml, "\ufeffa: 1\n")):
        assert load(written(tmp_path, text), "file") == {"a": 1}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no such pipes")
def test_a_pipe_in_a_folder_is_refused_and_a_shells_own_is_read(tmp_path):
    os.mkfifo(tmp_path / "file.yaml")
    with pytest.raises(ValueError, match=r"^file \(it is a pipe, no file\): mend the file$"):
        load_yaml(tmp_path / "file.yaml", "file")
    if Path("/dev/fd").exists():
        end, begin = os.pipe()
        os.write(begin, b"a: 1")
        os.close(begin)
        assert load_yaml(Path(f"/dev/fd/{end}"), "file") == {"a": 1}
        os.close(end)


def test_a_file_that_cannot_be_read_is_said_in_the_readers_own_words(tmp_path):
    with pytest.raises(LookupError, match=r"^file \(No such file or directory\): give another$"):
        load_yaml(tmp_path / "none.yaml", "file", mend="give another", error=LookupError)
    for path in (tmp_path, tmp_path / ("x" * 5000)):
        with pytest.raises(ValueError, match=r"^file \(.*\): mend the file$"):
            load_json(path, "file")


@pytest.mark.parametrize(
    "value",
    [
        *VALUES, 10**5000, [10**5000] * 1000, {k: [k] * 100 for k in range(1000)}, "x" * 10**7, b"x" * 10**6,
        np.zeros(10**6), np.zeros(3), np.float32(1), object(), "\u202e\n\0", [[[[[[1]]]]]], float,
    ],
    ids=lambda value: type(value).__name__,
)  # fmt: skip
def test_any_value_is_quoted_shortly_in_one_line(value):
    began = time.perf_counter()
    text = quoted(value)
    assert 0 < len(text) <= QUOTED
    assert text == one_line(text)
    assert time.perf_counter() - began < 0.1


def test_only_finite_real_numbers_are_numbers():
    for value in (0, -1, 1.5, 10**300, np.float32(1.5), np.int64(3)):
        assert is_number(value)
    for value in (True, np.bool_(True), float("nan"), float("inf"), np.float32("nan"), 10**400, "1", None, [1], 1j):
        assert not is_number(value)


class Inner(Open):
    count: int | None = None


class Form(Open):
    radius_m: float | None = None
    names: dict[str, Inner] | None = None
    either: float | list[float] | None = None


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"radius_m": "wide"}, "radius_m is 'wide': "),
        ({"radius_m": True}, "radius_m is True: "),
        ({"radius_m": float("nan")}, "radius_m is nan: "),
        ({"Radius_m": 1.0}, "Radius_m is unknown: did you mean 'radius_m'?"),
        ({"radius": 1.0}, "radius is unknown: did you mean 'radius_m'?"),
        ({"names": {"elbow": {"count": 1.5}}}, "names.elbow.count is 1.5: "),
        ({"names": {"elbow": {"counts": 1}}}, "names.elbow.counts is unknown: did you mean 'count'?"),
        ({"names": {"elbow": 3}}, "names.elbow is 3: "),
        ({"either": [1.0, "x"]}, "either[1] is 'x': "),
        ({"either": "x"}, "either is 'x': "),
        ([1], "is [1]: write a mapping"),
    ],
)
def test_a_schema_names_the_place_the_value_and_the_likely_slip(given, said):
    with pytest.raises(SchemaError) as caught:
        checked(Form, given)
    assert str(caught.value).startswith(said)


def test_a_users_own_keys_are_kept():
    assert checked(Form, {"radius_m": 1.0, "remark": "cold start"}).model_extra == {"remark": "cold start"}
