"""The speeds that docs/speed.md tells are those of the results, and of code no older than a release."""

import json
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))

import speed_tables  # noqa: E402


def test_the_tables_of_the_pages_are_what_the_command_makes_of_the_results():
    for page in speed_tables.PAGES:
        text = page.read_text(encoding="utf-8")
        assert "<!-- speed: " in text
        assert speed_tables.remade(text) == text, f"run python benchmarks/speed_tables.py: {page.name}"


def test_no_table_is_older_than_its_code_by_more_than_a_release():
    assert speed_tables.outdated((ROOT / "CHANGELOG.md").read_text(encoding="utf-8")) == []


def test_a_result_is_named_when_two_releases_came_after_it(tmp_path, monkeypatch):
    monkeypatch.setattr(speed_tables, "RESULTS", tmp_path)
    measured_with = {"warp": {}, "peers": {"tiago_mj": "0.2.0"}, "scaling": {"tiago_mj": "0.10.0"}}
    for name, machine in measured_with.items():
        (tmp_path / f"{name}.json").write_text(json.dumps({"machine": machine}))
    changelog = "## Unreleased\n\n## [0.10.0] - 2027-03-01\n\n## 0.2.0\n\n## 0.1.0\n"
    assert speed_tables.outdated(changelog) == ["warp.json: 0.10.0 and 0.2.0 came after it"]
    assert speed_tables.outdated(f"## 0.11.0\n\n{changelog}") == [
        "peers.json: 0.11.0 and 0.10.0 came after it",
        "warp.json: 0.11.0 and 0.10.0 and 0.2.0 came after it",
    ]
