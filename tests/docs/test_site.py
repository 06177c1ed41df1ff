"""The site's pages say what the code says, its plots show what they name, and nothing comes from a network."""

import subprocess
import sys
from pathlib import Path

import pytest

from docs.site import assemble, effects, environments, offline, plots
from docs.site.links import Rewriter
from docs.site.mathml import with_formulas
from tiago_mj import ENVIRONMENTS

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_a_page_of_an_environment_has_farama_s_sections_and_every_argument(name):
    page = environments.page(name, picture=True)
    positions = [page.index(f"\n## {title}\n") for title in environments.SECTIONS]
    assert positions == sorted(positions)
    assert f'gymnasium.make("tiago_mj/{name}")' in page
    for argument in ENVIRONMENTS[name].arguments:
        assert f"| `{argument}` |" in page
    assert "| `effects` |" in page
    assert ":class:" not in page


def test_a_page_of_an_environment_speaks_of_its_own_robot_and_observation_alone():
    gripper, blind = (environments.page(name, picture=False) for name in ("GripperTactile-v0", "TIAGoPALGripper-v0"))
    actions = gripper.partition("## Action Space")[2].partition("## Rewards")[0]
    assert "torso" not in actions
    assert "2N" not in actions
    assert "| 4, 5 | force right, left" in actions
    assert "desired_goal" not in actions
    assert "force right, left" not in blind.partition("## Observation Space")[2].partition("## Rewards")[0]
    assert "| 10 … 19 | joint velocities" in blind
    assert "rad" not in gripper.partition("## Observation Space")[2].partition("## Rewards")[0], "both joints slide"
    assert "| m, rad |" in blind
    assert "\n| | |\n" not in gripper + blind, "a table without a heading has no empty one"


def test_every_environment_is_on_one_page_of_the_overview():
    listed = [name for names in environments.families().values() for name in names]
    assert sorted(listed) == sorted(ENVIRONMENTS)


@pytest.mark.parametrize("name", ["backlash", "force_lag", "payload", "object_mass"])
def test_a_plot_shows_an_effect_in_the_colours_of_the_page(name):
    svg = plots.draw(name)
    assert "\n" not in svg
    assert "currentColor" in svg
    assert "#010203" not in svg
    assert "<text" in svg
    assert f"with {name}" in svg
    assert len(svg) < 80_000


@pytest.mark.slow
@pytest.mark.parametrize("name", effects.LIBRARY)
def test_every_effect_changes_what_its_plot_shows_or_the_page_says_why_not(name):
    least = {"mm": 0.05, "mm/s": 5, "sensor units": 0.05, "mrad": 2, "mrad/s": 20}
    shown, _ = plots.chosen(name)
    assert plots.difference(name) > least[plots.UNITS[shown.motion, shown.channel]] or name in plots.REMARKS


def test_an_effect_s_page_has_its_parameters_its_words_and_a_program_that_runs():
    page = effects.page("coulomb_friction", "<svg></svg>", "so")
    assert "| `force` |" in page
    assert "In a recording" in page
    program = page.split("```python\n")[1].split("```")[0]
    names = {}
    exec(program, names)
    names["env"].reset(seed=0)
    assert all(f"effects/{name}.md" in effects.catalogue() for name in effects.LIBRARY)


def test_formulas_become_mathml_and_code_stays():
    page = with_formulas("a $x^2$ b `$y$` $5 and $6\n\n$$\n\\frac{a}{b}\n$$\n\n```sh\necho $HOME $x$\n```\n")
    assert page.count("<math") == 2
    assert "<msup>" in page
    assert "<mfrac>" in page
    assert "`$y$`" in page
    assert "$5 and $6" in page
    assert "echo $HOME $x$" in page


def test_a_link_that_leads_nowhere_is_refused_with_where_it_stands():
    links = Rewriter(ROOT)
    with pytest.raises(ValueError, match=r"docs/a\.md links to \.\./nothing\.py"):
        links.page("[x](../nothing.py)", "a.md", "docs/a.md")
    text = links.page("[x](../LICENSE) [y](b.md#c) [z](https://example.org)", "tutorials/a.md", "docs/a.md")
    assert text == "[x](../repository/LICENSE.txt) [y](../b.md#c) [z](https://example.org)"
    assert links.files == {"LICENSE": "repository/LICENSE.txt"}


def test_what_a_page_loads_from_another_host_is_found(tmp_path):
    (tmp_path / "a.html").write_text(
        '<a href="https://ok.org"></a><script src="https://bad.org/a.js"></script>'
        '<link rel="stylesheet" href="//b.org/c">'
    )
    (tmp_path / "b.css").write_text("p { background: url(https://bad.org/a.png) }")
    assert len(offline.loads_of_others(tmp_path)) == 3


def test_every_page_is_in_the_navigation():
    def leaves(entry):
        if isinstance(entry, str):
            return [entry]
        parts = entry.values() if isinstance(entry, dict) else entry
        return [leaf for part in parts for leaf in leaves(part)]

    listed = leaves(assemble.configuration()["nav"])
    assert len(listed) == len(set(listed))
    assert set(assemble.pages()) <= set(listed)


@pytest.mark.slow
def test_the_site_is_built_with_strict_links_and_loads_nothing_of_others(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "docs.site", "build", "--out", tmp_path],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-1500:] + done.stderr[-1500:]
    html = tmp_path / "html"
    assert len(list((html / "effects").glob("*.html"))) == len(effects.LIBRARY)
    assert len(list((html / "environments").glob("*.html"))) == len(ENVIRONMENTS) + 1
    assert "<mfrac>" in (html / "diagnosis.html").read_text()
    assert "<svg" in (html / "effects" / "backlash.html").read_text()
    (tmp_path / "pages" / "index.md").write_text("[x](nowhere.md)")
    again = [sys.executable, "-m", "mkdocs", "build", "--strict", "-f", tmp_path / "mkdocs.yml"]
    assert subprocess.run(again, capture_output=True, check=False).returncode != 0, "a bad link must fail the build"
