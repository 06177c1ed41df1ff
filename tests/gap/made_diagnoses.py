"""Made-up diagnoses of every kind, for the tests of what is written of them."""

from __future__ import annotations

import dataclasses
import html.parser

import numpy as np
import pytest

from tiago_mj.gap.result import (
    BANDS,
    PHASES,
    Closing,
    Diagnosis,
    Explanation,
    FitQuality,
    FittedNumber,
    Named,
    NextMotion,
    Overlay,
    Place,
    Remains,
    ResidualShape,
    Shrink,
    Value,
    Verdict,
    identity,
)
from tiago_mj.recordings.recording import Finding

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


def replace(one, **changes):
    """A changed value; a diagnosis also by what its verdict says."""
    if isinstance(one, Diagnosis):
        said = {key: changes.pop(key) for key in ("kind", "alternatives", "not_excited") if key in changes}
        if (best := changes.pop("best", None)) is not None:
            said |= {"effects": best.effects, "probability": best.probability}
            rows = tuple(best if identity(row) == identity(best) else row for row in one.ranking)
            changes = {"ranking": rows, **changes}
        if {"remains", "remains_where"} & set(changes):
            flag = changes.pop("remains", one.remains)
            said["remains"] = Remains(flag, changes.pop("remains_where", one.remains_where))
        shrink, kind = changes.get("shrink", one.shrink), said.get("kind", one.kind)
        # 5 variances of the noise are left, where no numbers take them away.
        said["part"] = kind in ("effect", "ambiguous") and shrink.high == 0.96 and shrink.with_numbers is None
        one = one.with_verdict(**said)
    return dataclasses.replace(one, **changes)


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


def closing_of(before, named, after=1.4, known=True):
    """A gap before and after; the same where nothing is named."""
    if not named or before - 1 <= 0.1:
        return Closing(before, after if named else before, None)
    share = 1 - (max(after, 1.0) - 1) / (before - 1)
    return Closing(before, after, share, *((share - 0.05, min(share + 0.03, 1.0)) if known else ()))


def places_of(number, named):
    """Gap by phase of a channel; positions know no contact onset, and one place is worse than before."""
    rows = {}
    for k, phase in enumerate(PHASES):
        if number < 2 and phase == "contact onset":
            continue
        before = 3000.0 / (number + 1) ** 3 / (k + 1)
        rows[phase] = closing_of(before, named, 2.2 * before if (number, k) == (3, 1) else 1.1)
    return rows


def task_of(named):
    """Returns of two test trials."""
    ends = {
        f"{who}_{end}": mean + way * 6.0 for who, mean in RETURNS.items() for end, way in (("low", -1), ("high", 1))
    }
    trials = {f"grasp_{8 + k:02d}": {who: mean - 1.0 + 2 * k for who, mean in RETURNS.items()} for k in range(2)}
    task = {"policy": "pi", **RETURNS, **ends, "trials": trials}
    return task if named else {**task, "repaired": task["nominal"]}


RETURNS = {"nominal": -204.7, "repaired": -231.4, "measured": -229.8}


def diagnosis(kind="effect", best=(COULOMB,), *, alternatives=None, channels=GRIPPER, **changes) -> Diagnosis:
    """A whole answer of one kind."""
    rng = np.random.default_rng(3)
    loud = [(channels[0], "free motion"), (channels[-1], "hold"), (channels[-1], "loading")]
    chosen = Explanation(tuple(best), 0.93 if kind == "effect" else 0.55, 41.2 if best else 0.0)
    others = [
        Explanation((LAG,), 0.03, 12.0),
        Explanation((GAIN, CREEP), 0.02, 9.5),
        Explanation((STIFFNESS,), 0.01, 3.1),
    ]
    tied = alternatives if alternatives is not None else [chosen] if best else []
    ranked = [chosen, *(one for one in tied if one.effects != chosen.effects), *others, *([NOTHING] if best else [])]
    trials = tuple(f"grasp_{i:02d}" for i in range(10))
    named = bool(best)
    unexcited = ("clock_skew", "motor_cogging", "velocity_limit", "force_saturation", "object_mass", "rate_limit")
    remains = Remains(True, places(channels, rng, loud[1:])) if kind == "unknown" else Remains()
    made = Diagnosis(
        verdict=Verdict(kind, chosen.effects, chosen.probability, tuple(tied), remains, unexcited),
        where=places(channels, rng, loud if kind != "no_gap" else ()),
        stage="transmission" if kind in ("effect", "ambiguous") else None,
        shrink=Shrink(
            before=58.31,
            after=5.02 if named else 58.31,
            floor=1.0,
            closed=0.93 if named else None,
            low=0.88 if named else None,
            high=0.96 if named else None,
            per_channel={c: closing_of(120.0 / (i + 1) ** 2, named, known=i < 4) for i, c in enumerate(channels)},
            task=task_of(named),
            per_phase={p: closing_of(80.0 / (k + 1), named) for k, p in enumerate(PHASES)},
            per_place={c: places_of(i, named) for i, c in enumerate(channels)},
            resampled="2 test trials, and blocks of 0.5 s within each",
        ),
        ranking=tuple(sorted(ranked, key=lambda one: -one.probability)),
        findings=(
            *(Finding("time_origin", f"{t}.csv", "time", "time starts at 1.7e9 s; taken as 0", True) for t in trials),
            Finding("dead_channel", "grasp_02.csv", "force.left", "reads 0 throughout", discredits=True),
            Finding("quantum", "grasp_03.csv", "force.right", "readings come in steps of 0.01 sensor units"),
        ),
        next_motion=NextMotion("free_reversals_slow_25hz.csv", (("coulomb_friction", "backlash"),), 0.87)
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
    by_phase = {p: Closing(1.1, 1.1, None) for p in PHASES}
    places = dict.fromkeys(made.shrink.per_channel, by_phase)
    gap = Shrink(1.12, 1.12, 1.0, None, None, None, same, per_phase=by_phase, per_place=places)
    return replace(made, shrink=gap)


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
BOUND = replace(CASES["unknown_with_known"].best, evidence=FitQuality(-100.0, -8.0, 0.9, 1.1, edge=True))
CASES["at_a_bound"] = replace(
    CASES["unknown_with_known"],
    best=BOUND,
    ranking=(BOUND, *CASES["unknown_with_known"].ranking[1:]),
    remains=False,
    remains_where=(),
)
CASES["never_measured"] = replace(
    diagnosis(),
    shrink=replace(diagnosis().shrink, task={"policy": "ppo.zip", "nominal": -3.2, "repaired": -8.1, "measured": None}),
)
PLACED = ResidualShape("force.left", ("force_sensor",), "force", "frequency", 0.93, "touch", 0.12, 52.9, "Hz")
CASES["unknown_with_a_shape"] = diagnosis("unknown", (), stage="force_sensor", residual_shape=PLACED)
FASTER = ResidualShape(MOVES[0], ("timing", "command", "actuator"), "motion", "speed", 0.72, "direction", 0.65)
CASES["unknown_that_may_be_several"] = diagnosis("unknown", (COULOMB,), residual_shape=FASTER)
CHANCE = ResidualShape(MOVES[0], (), "unclear", "irregular", 0.17)
CASES["effect_and_an_irregular_rest"] = replace(CASES["effect_and_more"], residual_shape=CHANCE)
FITTED = (
    FittedNumber("servo_stiffness", (RIGHT,), "factor", 1.0198, 1.0174, 1.0222, "-", 1.0),
    FittedNumber("command_delay", "all", "seconds", 0.00078, 0.00044, 0.00112, "s", 0.0),
)


def with_numbers(made: Diagnosis, after: float = 1.31) -> Diagnosis:
    """The same, with numbers as fitted that close nearly all of the gap."""
    gap = made.shrink
    share = 1 - (after - 1) / (gap.before - 1)
    left = Closing(gap.before, after, share, share - 0.01, min(share + 0.002, 1.0))
    return replace(made, numbers=FITTED, shrink=replace(gap, with_numbers=left))


CASES["effect_and_numbers"] = with_numbers(diagnosis())
CASES["numbers_alone"] = with_numbers(diagnosis("no_gap", ()))
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
