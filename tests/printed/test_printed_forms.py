"""What is printed for a reader to run is well formed: found whole, parsed by the command's own parser, ids and extras
that there are. That it runs is tested by the slow tests beside this one."""

from __future__ import annotations

import ast
import contextlib
import io
import re
import shlex
import sys
import tomllib
from pathlib import Path

import gymnasium
import pytest
from printed_lines import PAGES, ROOT, Printed, blocks, commands, in_prose, of_output, of_page, of_report
from printed_tables import FAR, FIXTURES, LEFT_OUT, left_out

import tiago_mj  # noqa: F401  (registers the environments)
from tiago_mj.cli import build_parser
from tiago_mj.gap.report import html, terminal

sys.path.insert(0, str(ROOT / "tests" / "gap"))
from made_diagnoses import CASES, replace

ON_PAGES = [line for page in PAGES for line in (*of_page(page), *in_prose(page))]
EXTRAS = set(tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"])
#: Ids of which a page says that the reader registers them.
OWN_IDS = {"Turn-v0"}


def faults(line: Printed) -> list[str]:
    """What is wrong with the form of a line."""
    return _of_python(line.text) if line.kind == "python" else _of_shell(line.text)


def _of_python(text: str) -> list[str]:
    try:
        tree = ast.parse(text)
    except SyntaxError as fault:
        return [f"no Python: {fault}"]
    found = []
    for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        name = ast.unparse(call.func)
        if name in ("gymnasium.make", "gymnasium.make_vec", "make_sb3") and isinstance(call.args[0], ast.Constant):
            found += _of_id(str(call.args[0].value))
    return found


def _of_id(name: str) -> list[str]:
    if name in gymnasium.registry or name in OWN_IDS:
        return []
    return [f"gymnasium knows no {name}"]


def _of_shell(text: str) -> list[str]:
    found = []
    try:
        words = shlex.split(text.replace("\\\n", " ").replace("\n", " ; "), comments=True)
    except ValueError as fault:
        return [f"no line of a shell: {fault}"]
    for command in _apart(words):
        program = command[0].rpartition("/")[2]
        if program == "tiago-mj":
            found += _of_program(command[1:])
        elif "install" in command and any(word.endswith("pip") for word in command):
            found += _of_install(command)
        elif program.startswith("python") and command[1].endswith(".py") and "/" in command[1]:
            found += [] if (ROOT / command[1]).is_file() else [f"there is no {command[1]}"]
    return found


def _apart(words: list[str]) -> list[list[str]]:
    """Commands of a line: between &&, ; and pipes, without variables that are set before and files that are written."""
    words = [word for before, word in zip(["", *words], words, strict=False) if ">" not in (before, word)]
    found: list[list[str]] = [[]]
    for word in words:
        if word in ("&&", ";", "|", "do", "done"):
            found.append([])
        elif not (found[-1] == [] and re.fullmatch(r"[A-Z_]+=\S*", word)):
            found[-1].append(word.rstrip(";"))
    return [one for one in found if one]


def _of_program(words: list[str]) -> list[str]:
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
            build_parser(words[0]).parse_args(words)
    except SystemExit as left:
        if left.code:
            return [said.getvalue().strip()]
    return []


def _of_install(words: list[str]) -> list[str]:
    """Of this package: with the versions of the clone, and extras that there are; it is in no index."""
    given = " ".join(words)
    if re.search(r"tiago-mj(\[|$)", given) and "/" not in given:
        return ["tiago-mj is in no index: install it from its clone"]
    own = re.search(r"\[([\w,]+)\]", given) if re.search(r"(?:^| )\S*\.?\[|\.\[|tiago", given) else None
    if own is None or "imageio" in given or "minari[" in given:
        return []
    unknown = set(own[1].split(",")) - EXTRAS
    lacks = [] if "constraints.txt" in given else ["without -c constraints.txt, versions are not those of the tests"]
    return [f"no extras {unknown}"] * bool(unknown) + lacks


@pytest.mark.parametrize("page", sorted({line.page for line in ON_PAGES}))
def test_what_a_page_prints_is_well_formed(page: str) -> None:
    found = [
        f"{line.where}: {line.text}: {fault}"
        for line in ON_PAGES
        if line.page == page and not left_out(line)
        for fault in faults(line)
    ]
    assert not found, "\n".join(found)


def test_a_block_that_is_to_be_run_says_in_which_language() -> None:
    unsaid = [
        f"{page.relative_to(ROOT)}:{line}"
        for page in PAGES
        for line, kind, _, text in blocks(page)
        if not kind and list(commands(text)) and re.match(r"(tiago-mj|python|pip|[A-Z]=)", text)
    ]
    assert not unsaid


def of_diagnosis(name: str) -> list[Printed]:
    """What the report and the terminal print of a diagnosis."""
    shown = "\n".join(line for _, line in terminal.lines(CASES[name], {}))
    return [*of_report(html.render(CASES[name]), f"report of {name}"), *of_output(shown, f"terminal of {name}")]


@pytest.mark.parametrize("name", CASES)
def test_what_a_report_prints_is_well_formed(name: str) -> None:
    lines = of_diagnosis(name)
    assert lines
    found = [f"{line.text}: {fault}" for line in lines for fault in faults(line)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("name", CASES)
def test_a_report_names_the_extra_before_what_needs_it(name: str) -> None:
    """``gap`` is there, as it made the report."""
    texts = [line.text for line in of_diagnosis(name)]
    for place, text in enumerate(texts):
        if text.startswith("tiago-mj train"):
            assert any("pip install" in before and "[train]" in before for before in texts[:place]), text


@pytest.mark.parametrize("name", CASES)
def test_python_of_a_report_imports_what_it_uses(name: str) -> None:
    for line in of_diagnosis(name):
        if line.kind == "python":
            compile(line.text, "report", "exec")
            assert "import" in line.text


def test_names_given_to_a_diagnosis_are_quoted_in_what_it_prints() -> None:
    command = "tiago-mj diagnose 'my logs' --env GripperTactile-v0 --out 'my \"out\"'"
    given = replace(CASES["effect"], robot="GripperTactile-v0", command=command)
    lines = of_report(html.render(given), "report")
    assert not [fault for line in lines for fault in faults(line)]
    (make,) = (line.text for line in lines if line.kind == "python" and "env =" in line.text and "\n" in line.text)
    assert '"tiago_mj/GripperTactile-v0"' in make
    assert ast.literal_eval(re.search(r"effects=(.*)\)", make)[1]) == 'my "out"/calibration.yaml'


def test_every_entry_of_the_tables_is_of_a_line_that_is_printed() -> None:
    texts = [line.text for line in ON_PAGES]
    for entry in LEFT_OUT:
        assert any(left_out(line, (entry,)) for line in ON_PAGES), f"no line is left out by {entry}"
    for one in FIXTURES:
        assert any(one.name in line.text for line in ON_PAGES if line.page == one.page), f"no line names {one}"
    unused = [far.pattern for far in FAR if far.pages and not any(re.search(far.pattern, text) for text in texts)]
    assert not unused


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("tiago-mj doctor --jason", "unrecognized"),
        ("tiago-mj nothing", "invalid choice"),
        ("pip install 'tiago-mj[train]'", "in no index"),
        (".venv/bin/pip install -c constraints.txt '.[trian]'", "no extras"),
        ("python benchmarks/nothing.py", "there is no"),
    ],
)
def test_a_bad_line_is_found(text: str, said: str) -> None:
    assert said in " ".join(faults(Printed("here", "sh", text)))


def test_an_id_without_its_namespace_is_found() -> None:
    assert faults(Printed("here", "python", 'env = gymnasium.make("GripperTactile-v0")'))


def test_lines_are_found_whole(tmp_path: Path) -> None:
    text = (
        "# a comment\ncd there\nR=1\ntiago-mj a \\\n    --b   # why\nfor x in 1 2; do\n  echo $x\ndone\n\nray start\n"
    )
    assert list(commands(text)) == [
        (3, "cd there\nR=1\ntiago-mj a \\\n    --b   # why"),
        (5, "cd there\nR=1\nfor x in 1 2; do\n  echo $x\ndone"),
        (9, "cd there\nR=1\nray start"),
    ]
    said = "done\nnext: tiago-mj diagnose a --out b\n  tiago-mj record --env c\nneeds x; install with: pip install y\n"
    assert [one.text for one in of_output(said, "x")] == [
        "tiago-mj diagnose a --out b",
        "tiago-mj record --env c",
        "pip install y",
    ]
