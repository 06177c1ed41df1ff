"""Mutated files of every reader, and files that once broke one: a result or one line, soon, and nothing run.

Which mutations are tried is derived from the readers' names, so that every run tries the same. Many more are tried by
``tests/long/fuzz.py``.
"""

import json
import random
import resource
import shutil
import sys
import time
from pathlib import Path

import pytest
from fuzzing.bombs import BOMBS
from fuzzing.mutate import changed, mutations
from fuzzing.targets import COMMANDS, TARGETS
from fuzzing.verdicts import ACCEPTED, REFUSED, Watch, by_command, tried
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from tiago_mj.io import loading
from tiago_mj.io.quoting import HIDDEN

CORPUS = Path(__file__).parent / "corpus"
SECONDS, MEGABYTES = 20.0, 500.0
#: Of every reader by default; tests/long/fuzz.py tries some thousand.
INPUTS = 12
#: Bombs that take seconds to build, or to be ended by a limit of time.
LONG = (
    "bag: a view without end", "bag: a packed chunk", "bag: a packed file",
    "bag: code in a type's name", "bag: many fields", "bag: a huge constant",
)  # fmt: skip


@pytest.fixture(scope="session")
def watch():
    return Watch()


@pytest.fixture(scope="module")
def valid(tmp_path_factory):
    """Files of the valid input of a reader, written once, and read once: what it imports is its own affair."""
    made = {}

    def files(name):
        if name not in made:
            folder = tmp_path_factory.mktemp("valid")
            target = TARGETS.get(name) or COMMANDS[name]
            target.write(folder)
            made[name] = {
                str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()
            }
            if name in TARGETS:
                tried(TARGETS[name], folder)
        return made[name]

    return files


def placed(folder, files):
    shutil.rmtree(folder, ignore_errors=True)
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return folder


def peak():
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / 1e6 if sys.platform == "darwin" else most / 1e3


def outcome(name, folder, watch):
    """What came of an input; fails where a user would be left alone with it."""
    before, began = peak(), time.monotonic()
    verdict, said = tried(TARGETS[name], folder, watch)
    assert verdict in (ACCEPTED, REFUSED), f"{verdict}: {said[:500]}"
    assert time.monotonic() - began < SECONDS
    assert peak() - before < MEGABYTES
    return verdict


@pytest.mark.parametrize("name", [name for name in TARGETS if name != "policy zip"])
def test_the_valid_input_of_every_reader_is_accepted(name, valid, watch, tmp_path):
    source = placed(tmp_path / "in", valid(name))
    for _ in range(2):  # the second time what it writes is there
        assert outcome(name, source, watch) == ACCEPTED


@pytest.mark.parametrize("name", TARGETS)
def test_a_mutated_file_is_read_or_refused_in_one_line(name, valid, watch, tmp_path):
    files = valid(name)

    @settings(
        derandomize=True,
        database=None,
        deadline=None,
        max_examples=INPUTS,
        phases=[Phase.explicit, Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(file=st.sampled_from(sorted(files)), seed=st.integers(0, 2**32))
    def try_one(file, seed):
        _, data = changed(file, files[file], random.Random(seed))
        outcome(name, placed(tmp_path / "in", {**files, file: data}), watch)

    try_one()


CASES = sorted(CORPUS.glob("*.json"))


@pytest.mark.parametrize("case", CASES, ids=lambda path: path.stem)
def test_what_once_broke_a_reader_does_not_again(case, valid, watch, tmp_path):
    said = json.loads(case.read_text(encoding="utf-8"))
    name = said["reader"]
    files = {**valid(name), said["file"]: (CORPUS / said["content"]).read_bytes()}
    source = placed(tmp_path / "in", files)
    if name in COMMANDS:
        verdict, line = by_command(COMMANDS[name].command, source, tmp_path / "out")
        assert verdict == said["outcome"], line
    else:
        assert outcome(name, source, watch) == said["outcome"]


def bomb_outcome(bomb, watch, tmp_path):
    name, write = BOMBS[bomb]
    TARGETS[name].write(tmp_path)  # what a reader imports is not what a file costs
    tried(TARGETS[name], tmp_path)
    source = tmp_path / "in"
    source.mkdir()
    write(source)
    sentinel = Path("/tmp/tiago-mj-ran")
    assert not sentinel.exists()
    verdict = outcome(name, source, watch)
    assert not sentinel.exists()
    return verdict


@pytest.mark.parametrize("bomb", [bomb for bomb in BOMBS if bomb not in LONG])
def test_a_bomb_does_not_go_off(bomb, watch, tmp_path):
    harmless = ("parquet: repeated text", "mesh: nodes that double", "hdf5: a type among the arrays")
    assert bomb_outcome(bomb, watch, tmp_path) == (ACCEPTED if bomb in harmless else REFUSED)


@pytest.mark.slow
@pytest.mark.parametrize("bomb", LONG)
def test_a_bag_that_would_be_read_for_ever_ends_in_one_line(bomb, watch, tmp_path):
    assert bomb_outcome(bomb, watch, tmp_path) == REFUSED


@pytest.mark.parametrize("name", [name for name, target in TARGETS.items() if target.command and target.share < 2])
def test_the_command_leaves_nothing_behind_where_it_refuses(name, valid, tmp_path):
    rng = random.Random(name)
    files = valid(name)
    for number in range(6):
        file = rng.choice(sorted(files))
        _, data = changed(file, files[file], rng)
        source = placed(tmp_path / "in", {**files, file: data})
        verdict, said = by_command(TARGETS[name].command, source, tmp_path / f"out{number}")
        assert verdict in (ACCEPTED, REFUSED), f"{verdict}: {said}"


def test_every_kind_of_file_has_mutations_of_its_own():
    names = ("a.json", "a.yaml", "a.csv", "a.xml", "a.npz", "a.zip", "a.parquet", "a.urdf", "a.mcap", "a.hdf5", "a.stl")
    assert all(set(mutations(name)) > set(mutations("a")) for name in names)


# Properties of what all readers share ------------------------------------------------------------------------------

PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-loading.MAX_WHOLE, loading.MAX_WHOLE)
    | st.floats(allow_nan=False)
    | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=12,
)
DETERMINISTIC = settings(derandomize=True, database=None, deadline=None, max_examples=60)


@DETERMINISTIC
@given(PLAIN)
def test_json_of_any_value_that_can_be_seen_is_read_as_it_is(value):
    text = json.dumps(value, ensure_ascii=False)
    if all(one.isprintable() for one in strings(value)):
        assert loading.parse_json(text, "text") == value


@DETERMINISTIC
@given(st.binary(max_size=60))
def test_any_bytes_are_json_or_refused_in_one_line(data):
    try:
        loading.parse_json(data, "text")
    except ValueError as fault:
        line = str(fault)
        assert type(fault) is ValueError  # noqa: PT017
        assert len(line.splitlines()) == 1
        assert not HIDDEN.search(line)


def strings(value):
    if isinstance(value, str):
        yield value
    elif isinstance(value, list):
        for one in value:
            yield from strings(one)
    elif isinstance(value, dict):
        for key, one in value.items():
            yield key
            yield from strings(one)
