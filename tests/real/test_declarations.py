"""Every declaration of the benchmark of real recordings is complete, and none contradicts itself."""

import dataclasses
import re
import subprocess
from collections import Counter
from pathlib import Path

import mujoco
import pytest

from benchmarks.blind.dictionary import LIBRARY
from benchmarks.blind.score import class_of
from benchmarks.real import declare
from benchmarks.real.cases import CASES, REGRESSIONS, SOURCES
from benchmarks.real.score import PLACELESS, SIZE

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(params=CASES.values(), ids=CASES)
def case(request):
    return request.param


def test_there_are_enough_cases_of_enough_robots_and_kinds():
    robots = Counter(case.robot for case in CASES.values())
    recordings = Counter(case.recording for case in CASES.values())
    kinds = Counter(case.kind for case in CASES.values())
    assert len(CASES) >= 30
    assert len(robots) >= 8
    assert max(robots.values()) <= 6
    assert recordings[declare.COMMANDS] >= 8
    assert recordings[declare.EFFORTS] >= 8
    assert 2 * kinds[declare.SEMI] <= len(CASES)
    whole = {case.robot for case in CASES.values() if case.kind == declare.NOTHING}
    assert whole == set(robots)  # every robot's best model is asked, too


def test_a_case_says_all_that_a_reader_needs(case):
    assert re.fullmatch(r"[a-z0-9][a-z0-9-]+", case.name)
    assert case.kind in declare.KINDS
    assert case.recording in declare.RECORDINGS
    assert case.withheld
    assert case.nominal
    assert bool(case.causes) == (case.kind != declare.NOTHING)
    for name in case.may:
        assert name in LIBRARY
    for one in case.known:
        assert one["name"] in LIBRARY
        assert one["parameters"]


def test_a_truth_has_a_source_and_an_uncertainty(case):
    for cause in case.causes:
        assert cause.known_by in declare.KNOWN_BY
        assert len(cause.source) > 20
        assert "config" not in cause.known_by  # a value out of a configuration file is no truth
        for name in (*cause.effects, *cause.alike, *(other[0] for other in cause.others)):
            assert name in LIBRARY
        classes = {class_of(name) for name in cause.effects}
        for name in cause.alike:  # the same number: of the same class, or another name of the truth
            assert class_of(name) in classes
        if cause.value is None:
            assert cause.low is None
            assert cause.high is None
            continue
        assert cause.unit
        assert cause.low <= cause.value <= cause.high
        low, high = cause.accepted
        assert low < cause.value < high
        for _, low, high in cause.others:
            assert low < high
        if cause.effects[0] in ("servo_stiffness", "torque_constant"):
            assert SIZE[cause.effects[0]] == "factor"


def test_a_cause_is_on_a_joint_that_the_model_has(case):
    for cause in case.causes:
        if cause.target and case.joints:
            assert cause.target in case.joints
        if not cause.target:
            assert cause.effects[0] in PLACELESS or case.model is None


def test_what_gave_the_truth_is_not_diagnosed(case):
    places = {file.place for file in SOURCES[case.source].files}
    assert set(case.files) <= places
    assert set(case.truth_files) <= places
    if set(case.files) & set(case.truth_files):
        assert "regression:" in case.parts
        assert "diagnosed:" in case.parts
    if any(cause.known_by == declare.REGRESSION for cause in case.causes):
        assert case.truth_files or case.parts
        assert case.source in REGRESSIONS


def test_a_nominal_model_is_text_of_ours_and_compiles(case):
    if case.model is None:
        return
    text = case.model()
    assert "mesh" not in text
    assert "include" not in text
    model = mujoco.MjModel.from_xml_string(text)
    assert model.njnt == len(case.joints)


def test_a_source_says_where_every_file_is_from():
    for source in SOURCES.values():
        assert source.licence
        assert "/" in source.repository
        for file in source.files:
            assert re.fullmatch(r"[0-9a-f]{64}", file.sha256), file.place
            assert re.fullmatch(r"[0-9a-f]{40}", file.commit or source.commit), source.name
            assert not Path(file.place).is_absolute()
            assert source.url(file).endswith(file.path.replace(" ", "%20"))
    places = [file.place for source in SOURCES.values() for file in source.files]
    assert len(set(places)) == len(places)


def test_no_file_of_others_is_committed():
    listed = subprocess.run(
        ["git", "ls-files", "benchmarks/real", "tests/real"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if listed.returncode:
        pytest.skip("this is no checkout of git")
    assert {Path(name).suffix for name in listed.stdout.split()} <= {".py", ".md"}


def test_the_seal_is_of_everything_that_is_declared():
    cases = list(CASES.values())
    sealed = declare.seal(cases)
    assert sealed == declare.seal(list(CASES.values()))
    first = next(case for case in cases if case.causes)
    cause = dataclasses.replace(first.causes[0], value=1.01 * first.causes[0].value)
    changed = dataclasses.replace(first, causes=(cause, *first.causes[1:]))
    assert declare.seal([changed if case is first else case for case in cases]) != sealed
    other = dataclasses.replace(first, model=lambda: "<mujoco/>")
    assert declare.seal([other if case is first else case for case in cases]) != sealed
