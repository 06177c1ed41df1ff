"""Every line that a document prints runs as it is printed."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest
from printed_lines import PAGES, ROOT, Printed, clone, environment, in_prose, of_page, run
from printed_tables import INSTALL, fixtures, left_out, way_of

from docs.site import runner


def in_order(page: Path) -> list[Printed]:
    """What a page prints, from its top to its bottom; what it repeats, once."""
    found = sorted((*of_page(page), *in_prose(page)), key=lambda line: int(line.where.rpartition(":")[2]))
    first: dict[str, Printed] = {}
    for line in found:
        first.setdefault(line.text, line)
    return list(first.values())


#: The README is run in a fresh environment (test_printed_fresh.py), and tutorials as one program each
#: (tests/docs/test_tutorials.py).
HERE = [
    page
    for page in PAGES
    if page.name != "README.md" and (page.parent.name != "tutorials" or page.stem == "index") and in_order(page)
]


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.mark.slow
@pytest.mark.parametrize("page", HERE, ids=name_of)
def test_every_line_of_a_page_runs(page: Path, tmp_path: Path) -> None:
    clone(tmp_path)
    later = []
    for one in fixtures(name_of(page)):
        if one.before:
            later.append(one)
        else:
            one.make(tmp_path)
    (tmp_path / ".venv").mkdir()
    for part in ("bin", "lib", "pyvenv.cfg"):  # of this interpreter, as if it had been made here
        (tmp_path / ".venv" / part).symlink_to(Path(sys.prefix) / part)
    given = environment(tmp_path)
    faults = []
    for line in in_order(page):
        if left_out(line):
            continue
        for one in [one for one in later if one.before in line.text]:
            one.make(tmp_path)
            later.remove(one)
        since = time.monotonic()
        fault = run(resolved(line), way_of(line), tmp_path, given)
        print(f"{'fault' if fault else 'ran'} {time.monotonic() - since:4.0f} s  {line.where} {line.text!r}")
        if fault:
            faults.append(f"{line.where}: {line.text}\n    {fault}")
    assert not faults, "\n".join(faults)
    assert later == []


def resolved(line: Printed) -> Printed:
    """An install that is resolved and not made; any other line as it is."""
    return Printed(line.where, line.kind, INSTALL.sub("pip install --dry-run ", line.text))


def test_every_line_of_the_tutorials_is_run_by_their_test() -> None:
    """But for what a page says itself is not run."""
    for page in (page for page in PAGES if page.parent.name == "tutorials" and page.stem != "index"):
        ran = "\n".join(step.text for step in runner.steps(page.read_text(encoding="utf-8")))
        assert [line for line in in_order(page) if line.text not in ran and not left_out(line)] == []
