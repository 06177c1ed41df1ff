"""The files and lines of a diagnosis: what they say, that they are whole, equal, escaped and small."""

from __future__ import annotations

import base64
import gzip
import hashlib
import html.parser
import io
import json
import math
import re
import time
from dataclasses import replace

import numpy as np
import pytest
import yaml

from tiago_mj.gap import report
from tiago_mj.gap.effects import EFFECTS, read_effects
from tiago_mj.gap.recording import Finding
from tiago_mj.gap.report import calibration, overlays, tables, terminal, verdict, words
from tiago_mj.gap.report import html as page
from tiago_mj.gap.report import json as report_json
from tiago_mj.gap.report.clauses import CLAUSES, LESS
from tiago_mj.gap.result import (
    BANDS,
    PHASES,
    Closing,
    Diagnosis,
    Explanation,
    Named,
    NextMotion,
    Overlay,
    Place,
    Shrink,
    Value,
)

RIGHT, LEFT = "gripper_right_finger_joint", "gripper_left_finger_joint"
MOVES = tuple(f"{kind}.{joint}" for kind in ("position", "velocity") for joint in (RIGHT, LEFT))
GRIPPER = (*MOVES, "force.right", "force.left")
COULOMB = Named("coulomb_friction", (RIGHT,), {"force": Value(2.634567891, 2.41, 2.91, "N")})
LAG = Named("force_lag", "all", {"time_constant": Value(0.0312, 0.0287, 0.0341, "s")})
GAIN = Named("force_gain", "all", {"factor": Value(0.72, 0.68, 0.77, "-")})
STIFFNESS = Named("servo_stiffness", (RIGHT, LEFT), {"factor": Value(0.71, 0.66, 0.78, "-")})
CREEP = Named(
    "pad_creep", ("right",), {"fraction": Value(0.21, 0.17, 0.26, "-"), "time_constant": Value(0.33, 0.2, 0.52, "s")}
)
NOTHING = Explanation((), 0.01, 0.0)


def places(channels, rng, loud=()):
    """A gap table: every channel, phase and band that is long enough; ``loud`` holds most of the excess."""
    rows = []
    for channel in channels:
        for phase in PHASES:
            if phase == "contact onset" and channel.startswith("position"):
                continue
            for band in BANDS if phase in ("hold", "free motion") else BANDS[-2:]:
                gap = 1 + float(rng.exponential(0.3))
                if any(channel == c and phase == p for c, p in loud):
                    gap += float(rng.uniform(20, 300))
                rows.append([channel, phase, band, gap])
    excess = sum(max(row[3] - 1, 0) for row in rows)
    return tuple(Place(*row, row[3] * 0.8, row[3] * 1.3, max(row[3] - 1, 0) / excess) for row in rows)


def overlay(channels, rng, trial="grasp_09", repaired=True, rows=300):
    """A grasp: fingers close, touch, load, hold, open; the nominal simulator moves earlier and presses harder."""
    t = 0.04 * np.arange(rows)
    x = t / t[-1]
    phases = np.digitize(x, [0.05, 0.36, 0.4, 0.5, 0.86])
    phases = np.array([0, 1, 3, 4, 5, 6])[phases]

    def force(gain, late):
        return gain * np.clip((x - 0.38 - late) / 0.1, 0, 1) * (x < 0.86 + late)

    def position(late):
        return 0.045 - 0.03 * np.clip((x - 0.05 - late) / 0.33, 0, 1) + 0.03 * np.clip((x - 0.86 - late) / 0.1, 0, 1)

    def velocity(late):
        return np.gradient(position(late), t)

    made = {"force": lambda late: force(1 - 8 * late, late), "position": position, "velocity": velocity}
    made["effort"] = lambda late: 12 * np.sin(9 * x) + (2 + 30 * late) * np.sign(np.cos(9 * x))
    sigma = {"force": 0.01, "position": 1e-4, "velocity": 1e-3, "effort": 0.2}
    units = {"force": "sensor units", "position": "m", "velocity": "m/s", "effort": "N·m"}

    def signals(late, noise):
        kinds = {name: name.partition(".")[0] for name in channels}
        return {n: made[k](late) + noise * rng.normal(0, sigma[k], rows) for n, k in kinds.items()}

    return Overlay(
        trial=trial,
        time=t,
        phases=phases,
        measured=signals(0.03, 1),
        nominal=signals(0.0, 0),
        repaired=signals(0.029, 0) if repaired else {},
        units={n: units[n.partition(".")[0]] for n in channels},
        floor={n: sigma[n.partition(".")[0]] for n in channels},
    )


def diagnosis(kind="effect", best=(COULOMB,), *, alternatives=None, channels=GRIPPER, **changes) -> Diagnosis:
    """A whole answer of one kind."""
    rng = np.random.default_rng(3)
    loud = [(channels[0], "free motion"), (channels[-1], "hold"), (channels[-1], "loading")]
    chosen = Explanation(tuple(best), 0.93 if kind == "effect" else 0.55, 41.2)
    others = [
        Explanation((LAG,), 0.03, 12.0),
        Explanation((GAIN, CREEP), 0.02, 9.5),
        Explanation((STIFFNESS,), 0.01, 3.1),
    ]
    tied = alternatives if alternatives is not None else [chosen] if best else []
    ranked = [chosen, *(one for one in tied if one.effects != chosen.effects), *others, NOTHING]
    trials = tuple(f"grasp_{i:02d}" for i in range(10))
    named = bool(best)
    made = Diagnosis(
        kind=kind,
        best=chosen,
        alternatives=tuple(tied),
        remains=kind == "unknown",
        remains_where=places(channels, rng, loud[1:]) if kind == "unknown" else (),
        not_excited=("clock_skew", "motor_cogging", "velocity_limit", "force_saturation", "object_mass", "rate_limit"),
        where=places(channels, rng, loud if kind != "no_gap" else ()),
        stage="transmission" if kind in ("effect", "ambiguous") else None,
        shrink=Shrink(
            before=58.31,
            after=5.02 if named else None,
            floor=1.0,
            closed=0.93 if named else None,
            low=0.88 if named else None,
            high=0.96 if named else None,
            per_channel={
                c: Closing(
                    120.0 / (i + 1) ** 2, 1.4 if named else 120.0 / (i + 1) ** 2, 0.93 if named and i < 4 else None
                )
                for i, c in enumerate(channels)
            },
            task={"policy": "pi", "nominal": -204.7, "repaired": -231.4, "measured": -229.8},
        ),
        ranking=tuple(sorted(ranked, key=lambda one: -one.probability)),
        findings=(
            *(Finding("time_origin", f"{t}.csv", "time", "time starts at 1.7e9 s; taken as 0", True) for t in trials),
            Finding("dead_channel", "grasp_02.csv", "force.left", "reads 0 throughout", discredits=True),
            Finding("quantum", "grasp_03.csv", "force.right", "readings come in steps of 0.01 sensor units"),
        ),
        next_motion=NextMotion("slow_triangle_25hz.csv", (("coulomb_friction", "backlash"),), 0.87)
        if kind == "ambiguous"
        else None,
        splits={"train": trials[:5], "validation": trials[5:8], "test": trials[8:]},
        robot="tiago_mj/GripperTactile-v0",
        complete=True,
        seed=0,
        version="0.1.0",
        seconds=37.4,
        overlays=(overlay(channels, rng, repaired=named),),
        command="tiago-mj diagnose recordings --env tiago_mj/GripperTactile-v0 --out out --seed 0",
    )
    return replace(made, **changes)


BACKLASH = Explanation((Named("backlash", (RIGHT, LEFT), {"width": Value(0.0011, 0.0009, 0.0014, "m")}),), 0.38, 40.1)
STUCK = Explanation(
    (
        Named(
            "stribeck_friction",
            "all",
            {"static": Value(3.1, 2.2, 4.0, "N"), "velocity": Value(0.01, 0.004, 0.02, "m/s")},
        ),
    ),
    0.05,
    39.0,
)
TIED = [Explanation((COULOMB,), 0.55, 41.2), BACKLASH]
LONG = tuple(f"effort.arm_{'very_' * 12}long_joint_name_{i}" for i in range(1, 13))


def untested(made: Diagnosis) -> Diagnosis:
    """The same, from too few trials for a test."""
    none = Shrink(None, None, 1.0, None, None, None)
    splits = {**made.splits, "test": ()}
    return replace(made, shrink=none, splits=splits, notes=("Two trials only: none was kept aside to test on.",))


def predicted(made: Diagnosis) -> Diagnosis:
    """The same, with nothing to close."""
    same = {c: Closing(1.1, 1.1, None) for c in made.shrink.per_channel}
    return replace(made, shrink=Shrink(1.12, 1.12, 1.0, None, None, None, same))


CASES = {
    "effect": diagnosis(),
    "two_effects": diagnosis(best=(COULOMB, LAG)),
    "same_effect_twice": diagnosis(best=(COULOMB, replace(COULOMB, target=LEFT))),
    "no_gap": predicted(diagnosis("no_gap", ())),
    "ambiguous": diagnosis("ambiguous", alternatives=TIED),
    "ambiguous_three": diagnosis("ambiguous", alternatives=[*TIED, STUCK]),
    "unknown": diagnosis("unknown", ()),
    "unknown_with_known": diagnosis("unknown", (COULOMB,)),
    "effect_and_more": replace(diagnosis("unknown", (COULOMB,)), kind="effect"),
    "no_test_trial": untested(diagnosis()),
    "no_force": diagnosis(channels=MOVES),
    "inverse_effort": diagnosis(
        best=(Named("coulomb_friction", tuple(f"arm_{i}_joint" for i in range(1, 5)), COULOMB.parameters),),
        channels=tuple(f"effort.arm_{i}_joint" for i in range(1, 8)),
        robot="robots/arm <left> & right.xml",
    ),
    "twelve_long_channels": diagnosis(channels=LONG),
    "cut_short": diagnosis(complete=False),
    "nothing_compared": diagnosis("unknown", (), where=(), overlays=(), ranking=(), remains_where=()),
}
every_case = pytest.mark.parametrize("name", CASES)


class Read(html.parser.HTMLParser):
    """Words, references and scripts of a page; complains about tags that do not close."""

    VOID = frozenset({"meta", "link", "br", "img", "hr", "input", "col", "wbr"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words, self.references, self.open, self.scripts = "", [], [], {}
        self.feed(text)
        assert not self.open, f"never closed: {self.open}"

    def handle_starttag(self, tag, attrs):
        self.references += [value for name, value in attrs if name in ("src", "href", "srcset", "poster", "action")]
        if tag == "script":
            self.script = dict(attrs).get("id", f"script {len(self.scripts)}")
            self.scripts[self.script] = ""
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag, f"</{tag}> closes nothing"

    def handle_data(self, data):
        if self.open and self.open[-1] == "script":
            self.scripts[self.script] += data
        elif "style" not in self.open:
            self.words += data


def squeezed(text: str) -> str:
    return " ".join(text.split())


# diagnosis.json


@every_case
def test_a_diagnosis_has_exactly_the_keys_of_its_contract_and_only_finite_numbers(name, tmp_path):
    report_json.write(CASES[name], tmp_path / "diagnosis.json")

    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    data = json.loads((tmp_path / "diagnosis.json").read_text(), parse_constant=refuse)
    assert list(data) == [
        *("schema", "verdict", "where", "stage", "shrink", "ranking", "lint", "next_motion", "splits"),
        *("robot", "notes", "complete", "seed", "version", "seconds"),
    ]
    assert data["schema"] == "tiago_mj.diagnosis/1"
    assert list(data["verdict"]) == ["kind", "effects", "probability", "alternatives", "remains", "not_excited"]
    assert list(data["verdict"]["remains"]) == ["flag", "where"]
    assert list(data["shrink"]) == [*("before", "after", "floor", "closed", "low", "high"), "per_channel", "return"]
    for effect in data["verdict"]["effects"]:
        assert list(effect) == ["name", "target", "parameters"]
        assert all(list(p) == ["value", "low", "high", "unit"] for p in effect["parameters"].values())
    for row in data["where"]:
        assert list(row) == ["channel", "phase", "band", "gap", "low", "high", "share"]
    for row in data["ranking"]:
        assert list(row) == ["effects", "validation_gain", "probability", "parameters"]
        assert len(row["parameters"]) == len(row["effects"])
    for row in data["verdict"]["alternatives"]:
        assert list(row) == ["effects", "probability"]
        assert all(list(effect) == ["name", "target"] for effect in row["effects"])
    for row in data["lint"]:
        assert list(row) == ["code", "file", "channel", "message", "repaired"]
    assert list(data["splits"]) == ["train", "validation", "test"]


def test_a_target_is_a_name_a_list_of_names_or_all():
    data = report_json.as_data(diagnosis(best=(COULOMB, LAG)))
    assert [effect["target"] for effect in data["verdict"]["effects"]] == [RIGHT, "all"]
    data = report_json.as_data(diagnosis(best=(STIFFNESS,)))
    assert data["verdict"]["effects"][0]["target"] == [RIGHT, LEFT]


@every_case
def test_a_diagnosis_read_back_writes_the_same_file(name, tmp_path):
    first, second = tmp_path / "first.json", tmp_path / "second.json"
    report_json.write(CASES[name], first)
    read = report_json.load(first)
    report_json.write(read, second)
    assert first.read_bytes() == second.read_bytes()
    assert verdict.headline(read) == verdict.headline(CASES[name])


def test_equal_diagnoses_are_equal_files_down_to_rounding_and_the_order_of_channels():
    one = diagnosis()
    turned = replace(one.shrink, per_channel=dict(reversed(one.shrink.per_channel.items())), before=58.31 + 1e-9)
    assert report_json.text(one) == report_json.text(replace(one, shrink=turned))
    assert report_json.text(one) != report_json.text(replace(one, shrink=replace(one.shrink, before=58.32)))
    assert '"value": 2.63457,' in report_json.text(one)


def test_unknown_numbers_are_null_and_numpy_numbers_are_numbers():
    cleaned = report_json.clean(
        {"a": math.nan, "b": [np.float64(1 / 3), -math.inf], "c": np.int64(2), "d": np.bool_(True)}
    )
    assert cleaned == {"a": None, "b": [0.333333, None], "c": 2, "d": True}
    assert json.dumps(report_json.clean(-0.0)) == "0.0"


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "no diagnosis at"),
        ("{", "cannot be read as JSON"),
        ('{"schema": "other/2"}', "has schema 'other/2'"),
        ('{"schema": "tiago_mj.diagnosis/1"}', "is incomplete"),
        ("[1]", "has schema None"),
    ],
)
def test_a_file_that_is_no_diagnosis_ends_in_one_line(content, says, tmp_path):
    path = tmp_path / "diagnosis.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(ValueError, match=says) as caught:
        report_json.load(path)
    assert "\n" not in str(caught.value)


# calibration.yaml


@every_case
def test_the_environments_load_what_a_calibration_holds(name, tmp_path):
    given = CASES[name]
    written = report.write(given, tmp_path)
    path, source = written["calibration.yaml"], written["diagnosis.json"]
    data = yaml.safe_load(path.read_text())
    assert list(data) == ["schema", "robot", "effects", "source"]
    assert data["schema"] == "tiago_mj.calibration/1"
    assert data["robot"] == given.robot
    assert data["source"] == {"file": "diagnosis.json", "sha256": hashlib.sha256(source.read_bytes()).hexdigest()}
    entries = read_effects(path)
    assert [entry.name for entry in entries] == [effect.name for effect in given.best.effects]
    for entry, effect in zip(entries, given.best.effects, strict=True):
        whom = (effect.target,) if isinstance(effect.target, str) else effect.target
        assert entry.target == (None if effect.target == "all" else whom)
        for key, value in effect.parameters.items():
            assert entry.parameters[key] == pytest.approx(value.value, rel=1e-5)  # six significant digits
    for effect in data["effects"]:
        assert all({"value", "low", "high"} <= set(p) for p in effect["parameters"].values())


def test_small_and_large_values_stay_numbers_in_a_calibration(tmp_path):
    tiny = Named("encoder_quantization", (RIGHT,), {"step": Value(1.53e-5, 1e-6, math.inf, "m")})
    path = report.write(diagnosis(best=(tiny,), overlays=()), tmp_path)["calibration.yaml"]
    assert yaml.safe_load(path.read_text())["effects"][0]["parameters"]["step"] == {
        "value": 1.53e-5,
        "low": 1e-6,
        "high": None,
        "unit": "m",
    }
    assert read_effects(path)[0].parameters["step"] == 1.53e-5


# Sentences


def test_the_headline_says_what_is_different_by_how_much_and_how_far_the_gap_shrinks():
    assert verdict.headline(diagnosis()) == (
        "The gripper's right finger has 2.6 N (2.4–2.9) of Coulomb friction that the simulator lacks; adding it closes "
        "93 % (88–96 %) of the gap on recordings that were kept aside."
    )


def test_a_sentence_begins_with_a_capital_letter_but_a_joint_keeps_its_name():
    assert words.begin("one of them") == "One of them"
    assert verdict.headline(CASES["inverse_effort"]).startswith(
        "arm_1_joint, arm_2_joint, arm_3_joint and arm_4_joint have"
    )


def test_what_is_less_than_nominal_is_said_without_a_minus_sign():
    less = Named("viscous_friction", (LEFT,), {"damping": Value(-12.0, -15.0, -9.0, "N·s/m")})
    assert (
        words.clause(less) == "the gripper's left finger has 12 N·s/m (9–15) less viscous friction than the simulator"
    )


def test_each_kind_of_verdict_has_its_sentence():
    assert "so no effect is named" in verdict.headline(CASES["no_gap"])
    ambiguous = verdict.headline(CASES["ambiguous"])
    assert "cannot tell which" in ambiguous
    assert "Coulomb friction" in ambiguous
    assert "1.1 mm (0.9–1.4) of play" in ambiguous
    assert verdict.headline(CASES["unknown"]).startswith(
        "There is a gap that no known effect explains; most of it lies in"
    )
    known = verdict.headline(CASES["unknown_with_known"])
    assert "Coulomb friction" in known
    assert "no known effect" in known
    assert "A gap above the noise is left" in verdict.remainder(CASES["effect_and_more"])
    assert "no recording was kept aside" in verdict.headline(CASES["no_test_trial"])


def test_a_repair_that_does_not_help_is_not_praised():
    worse = diagnosis()
    worse = replace(worse, shrink=replace(worse.shrink, closed=-0.2, low=-0.4, high=0.0))
    assert "does not close the gap" in verdict.headline(worse)


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_has_a_clause_that_names_its_parameters(name):
    declared = EFFECTS[name]
    values = {key: Value(0.5, 0.4, 0.6, p.unit[0]) for key, p in declared.parameters.items()}
    target = {"joint": (RIGHT,), "command": (RIGHT,), "sensor": ("right",)}.get(declared.targets, "all")
    said = words.clause(Named(name, target, values))
    assert "there is" not in said, "the fallback is for a user's own effects"
    assert "{" not in said
    assert said.count("(") == len(values), "each parameter with its interval"
    assert 3 < len(words.meaning(name).split()) < 40
    if name in LESS:
        values = {key: replace(v, value=-0.5, low=-0.6, high=-0.4) for key, v in values.items()}
        assert "−" not in words.clause(Named(name, target, values))


def test_clauses_belong_to_effects():
    assert set(CLAUSES) <= set(EFFECTS)
    assert set(LESS) <= set(CLAUSES)


def test_an_effect_of_a_users_own_is_said_by_its_name():
    own = Named("cable_tug", ("arm_1_joint",), {"pull": Value(1.5, None, None, "N")})
    assert words.clause(own) == "there is cable tug on arm_1_joint (pull 1.5 N)"


def test_numbers_show_as_many_digits_as_their_interval_supports():
    assert words.amount(Value(0.03124, 0.02871, 0.03412, "s")) == "31 ms (29–34)"
    assert words.amount(Value(1534.2, 1401.0, 1702.0, "N/m")) == "1534 N/m (1401–1702)"
    assert words.amount(Value(-0.3, -0.52, 0.11, "N")) == "−0.3 N (−0.5 to 0.1)"
    assert words.amount(Value(0.72, None, None, "-")) == "0.72"
    assert words.number(None) == "–"
    assert words.number(123456.0) == "123000"
    assert words.percent(0.004) == "0.4 %"


# report.html


@every_case
def test_a_page_is_one_small_file_that_needs_nothing_else(name):
    began = time.perf_counter()
    text = page.render(CASES[name])
    # 2 s is what a user may wait; compressing the script takes most of it, once.
    assert time.perf_counter() - began < 2
    assert len(text.encode()) < 6e6
    read = Read(text)
    assert set(read.references) <= {"data:,"}
    assert not re.search(r"@import|url\(", text[: text.index("</style>")])
    assert squeezed(verdict.headline(CASES[name])) in squeezed(read.words.replace("\N{WORD JOINER}", ""))
    for heading in ("Where", "Which", "How far", "What remains", "How these numbers were made"):
        assert heading in read.words
    assert "None" not in read.words
    assert "nan" not in read.words.lower().split()


@every_case
def test_figures_hold_to_plotlys_schema_one_per_channel_with_units(name):
    figure_of = pytest.importorskip("plotly.graph_objects").Figure
    scripts = Read(page.render(CASES[name])).scripts
    if not CASES[name].overlays:
        assert scripts == {}
        return
    figures = json.loads(scripts["figures"])
    assert len(figures) == len(CASES[name].overlays[0].measured)
    for figure in figures.values():
        figure_of(figure)  # raises on any unknown key or value
        assert figure["layout"]["xaxis"]["title"]["text"] == "time [s]"
        assert re.search(r"\[.+\]", figure["layout"]["yaxis"]["title"]["text"])
        roles = [trace["meta"]["role"] for trace in figure["data"]]
        assert roles[:2] == ["measured", "nominal"]
        assert ("repaired" in roles) == bool(CASES[name].best.effects)
    script = gzip.decompress(base64.b64decode(scripts["plotly"]))
    assert b"Plotly" in script


def test_what_comes_from_files_is_text_and_never_markup():
    evil = "<script>alert('x')</script>"
    channel = f"force.{evil}"
    rng = np.random.default_rng(0)
    shown = overlay(("force.right",), rng, trial=evil)
    renamed = {
        key: {channel: getattr(shown, key)["force.right"]} for key in ("measured", "nominal", "repaired", "floor")
    }
    given = diagnosis(
        best=(Named("force_lag", (evil,), {"time_constant": Value(0.03, 0.02, 0.04, evil)}),),
        channels=("force.right",),
        overlays=(replace(shown, units={channel: evil}, **renamed),),
        where=tuple(replace(p, channel=channel) for p in places(("force.right",), rng)),
        splits={"train": (evil,), "validation": (evil,), "test": (evil,)},
        findings=(Finding("quantum", evil, evil, evil),),
        notes=(evil,),
        robot=evil,
        command=evil,
        version=evil,
        next_motion=NextMotion(evil, ((evil, evil),), 0.5),
    )
    text = page.render(given)
    assert "<script>alert" not in text
    assert len(Read(text).scripts) == 3, "figures, Plotly, the page's own"
    assert Read(text).words.count(evil) > 10
    figures = json.loads(Read(text).scripts["figures"])
    assert all("<" not in f["layout"]["yaxis"]["title"]["text"] for f in figures.values()), "Plotly reads markup"
    assert all("<" not in trace["hovertemplate"] for f in figures.values() for trace in f["data"])


def test_the_heat_map_puts_the_loudest_channel_first_and_shares_sum_to_the_whole():
    shown = tables.heat(diagnosis().where)
    assert shown.by_share
    assert shown.rows[0][0] in (GRIPPER[0], GRIPPER[-1])
    total = sum(p.share for p in diagnosis().where)
    assert total == pytest.approx(1)
    strengths = [cell.strength for _, _, cells in shown.rows for cell in cells if cell]
    assert max(strengths) == 1
    assert any(cell is None for _, _, cells in shown.rows for cell in cells), "no contact onset on positions"


def test_a_map_without_excess_shows_the_gap_itself():
    flat = tuple(replace(p, share=0.0) for p in CASES["no_gap"].where)
    shown = tables.heat(flat)
    assert not shown.by_share
    assert all(cell.text for _, _, cells in shown.rows for cell in cells if cell)


def test_thinning_a_long_signal_keeps_its_peaks_and_its_pauses():
    t = np.arange(200_000) / 1000
    y = np.sin(t)
    y[12_345], y[150_001] = 9.0, -7.0
    y[60_000:80_000] = np.nan
    x, thin = overlays.thinned(t, y, 1000)
    assert len(x) == len(thin) <= 1100
    known = [v for v in thin if v is not None]
    assert max(known) == 9.0
    assert min(known) == -7.0
    assert thin.count(None) == 1
    at = thin.index(None)
    assert 60 < x[at] < 80
    assert x == sorted(x)


def test_a_signal_that_is_sampled_in_every_third_row_is_still_a_line():
    t = np.arange(90) / 30
    y = np.where(np.arange(90) % 3 == 0, t, np.nan)
    x, shown = overlays.thinned(t, y, 500)
    assert len(x) == 30
    assert None not in shown


def test_phases_are_stretches_and_a_flickering_one_is_bounded():
    t = np.arange(6.0)
    assert overlays.stretches(t, np.array([0, 0, 1, 1, 1, 5])) == [(0, 0.0, 2.0), (1, 2.0, 5.0), (5, 5.0, 5.0)]
    flicker = np.arange(10_000) % 2
    assert len(overlays.stretches(np.arange(10_000.0), flicker)) <= overlays.STRETCHES + 1
    assert overlays.stretches(np.empty(0), np.empty(0, int)) == []


def test_files_are_written_whole_or_not_at_all(tmp_path, monkeypatch):
    report.write(diagnosis(), tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert set(before) == {"diagnosis.json", "calibration.yaml", "report.html"}

    def breaks(*_):
        raise OSError("disk full")

    monkeypatch.setattr("pathlib.Path.replace", breaks)
    with pytest.raises(OSError, match="disk full"):
        report.write(diagnosis(seed=1), tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


# Terminal


@every_case
def test_the_terminal_says_the_same_in_short(name):
    console = pytest.importorskip("rich.console").Console(file=io.StringIO(), width=100)
    terminal.show(CASES[name], console=console)
    said = console.file.getvalue()
    assert squeezed(verdict.headline(CASES[name])) in squeezed(said)
    assert len(said.splitlines()) < 40
    assert ("How far" in said) == (CASES[name].shrink.before is not None and CASES[name].kind != "no_gap")


def test_names_in_brackets_are_printed_as_they_are(tmp_path):
    console = pytest.importorskip("rich.console").Console(file=io.StringIO(), width=100)
    terminal.show(diagnosis(notes=("trial [red]odd[/red] was left out",)), {"report.html": tmp_path}, console=console)
    assert "[red]odd[/red]" in console.file.getvalue()
    assert f"Written: {tmp_path}" in console.file.getvalue()


def test_progress_moves_on_a_terminal_and_is_silent_elsewhere():
    make = pytest.importorskip("rich.console").Console
    for is_terminal in (True, False):
        console = make(file=io.StringIO(), force_terminal=is_terminal, width=100)
        with terminal.Progress(console=console) as progress:
            progress.stage("replay [1]", 10)
            progress.advance(10)
            progress.stage("fit", None)
            progress.advance()
        assert ("replay [1]" in console.file.getvalue() or "fit" in console.file.getvalue()) == is_terminal


def test_progress_before_a_stage_is_refused():
    with terminal.Progress(quiet=True) as progress, pytest.raises(RuntimeError, match=r"stage\(name, total\)"):
        progress.advance()


def test_the_source_of_a_calibration_has_to_exist(tmp_path):
    with pytest.raises(FileNotFoundError):
        calibration.text(diagnosis(), tmp_path / "diagnosis.json")
