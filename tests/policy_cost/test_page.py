"""Figures and printed lines of docs/policy-cost.md: those of its result file, and what the command prints today."""

import json
import re
from pathlib import Path

import pytest
import yaml

from tiago_mj import cli

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "policy-cost.md").read_text(encoding="utf-8")
RESULTS = json.loads((ROOT / "benchmarks" / "results" / "policy_cost.json").read_text(encoding="utf-8"))["results"]
SHOWN = re.search(r"<!-- figures: policy cost -->\n```text\n(.*?)```", PAGE, re.DOTALL)[1]
TOGETHER = PAGE.partition("**Together.**")[2].partition("\n\n")[0]
NUMBER = re.compile(r"−?\d+(?:\.\d+)?")


def test_the_page_prints_what_the_benchmark_printed():
    assert RESULTS["steady"]["ppo-steady"]["printed"] == SHOWN


#: Cases, and the policies of each.
PLAYED = [
    (case, who)
    for case, found in RESULTS.items()
    for who, one in found.items()
    if isinstance(one, dict) and "truth" in one
]


@pytest.mark.parametrize(("case", "policy"), PLAYED)
def test_the_costs_of_what_was_found_hold_those_of_what_was_hidden(case, policy):
    one = RESULTS[case][policy]
    for row in one["data"]["effects"]:
        found, true = row["mended"]["episode_return"], one["truth"]["costs"][row["name"]]["episode_return"]["mean"]
        assert found["low"] <= true <= found["high"]


def test_the_pages_sentences_have_the_figures_of_the_result_file():
    for policy in ("ppo-steady", "pi-tuned"):
        one = RESULTS["steady"][policy]
        (row,) = [row for row in one["data"]["effects"] if row["name"] == "command_delay"]
        truth = one["truth"]["costs"]["command_delay"]["episode_return"]["mean"]
        assert f"{row['mended']['episode_return']['mean']:.1f}" in PAGE
        assert f"{truth:.1f}" in PAGE
    paper = {row["name"]: row for row in RESULTS["paper"]["pi"]["data"]["effects"]}
    for row, kind in (("force_bias", "mended"), ("command_delay", "mended"), ("command_delay", "alone")):
        assert f"{paper[row][kind]['episode_return']['mean']:.1f}" in TOGETHER
    other = RESULTS["paper"]["pi"]["data"]["others"][0]["total"]["episode_return"]["mean"]
    assert f"{other:.1f}" in TOGETHER
    assert f"took {RESULTS['steady']['ppo-steady']['seconds']:.0f} s of processor time" in PAGE


@pytest.mark.slow
def test_the_command_prints_what_the_page_shows(tmp_path, capsys):
    calibration = {
        "schema": "tiago_mj.calibration/1",
        "robot": "GripperTactileSteady-v0",
        "effects": RESULTS["steady"]["named"],
    }
    (tmp_path / "calibration.yaml").write_text(yaml.safe_dump(calibration))
    assert cli.main(["cost", str(tmp_path), "--policy", "ppo-steady"]) == 0
    said = capsys.readouterr().out
    assert NUMBER.sub("#", said).split() == NUMBER.sub("#", SHOWN).split()
    for number, shown in zip(NUMBER.findall(said), NUMBER.findall(SHOWN), strict=True):
        assert float(number.replace("−", "-")) == pytest.approx(float(shown.replace("−", "-")), rel=0.02, abs=1.0)
