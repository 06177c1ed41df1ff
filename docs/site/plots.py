"""How each effect looks in a recording: the nominal simulator and the one with the effect, on one motion."""

from __future__ import annotations

import io
import math
import re
from dataclasses import dataclass
from functools import cache
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from docs.site import motions
from tiago_mj.effects import EFFECTS
from tiago_mj.effects.fields import Parameter

#: Colours that stand out from white and from near-black alike; the rest has the colour of the page's text.
NOMINAL, EFFECT, TEXT = "#8a919e", "#e8590c", "#010203"
UNITS: Final = {
    ("air", "position"): "mm",
    ("grasp", "position"): "mm",
    ("hinge", "position"): "mrad",
    ("wrist", "position"): "mrad",
    ("elbow", "position"): "mrad",
    ("air", "velocity"): "mm/s",
    ("grasp", "velocity"): "mm/s",
    ("hinge", "velocity"): "mrad/s",
    ("grasp", "force"): "sensor units",
    ("push", "force"): "sensor units",
}
MOTIONS: Final = {
    "air": "the fingers in the air",
    "grasp": "the fingers at an object",
    "push": "one finger pushes an object over the table to the other",
    "hinge": "a link on a hinge, lifted and lowered",
    "wrist": "a hand that rolls on a forearm, lifted and lowered",
    "elbow": "an elbow that is held while the shoulder lifts and lowers the arm",
}


@dataclass(frozen=True)
class Shown:
    """On what an effect is shown.

    Attributes:
        motion, channel: of :mod:`docs.site.motions`.
    """

    motion: str
    channel: str


#: What has to be said of a plot that shows little.
REMARKS: Final = {
    "contact_friction": "It hardly shows here: nothing pulls at the object across the pads.",
    "gravity_tilt": "The servo is stiff, so that a tilted gravity moves the link by little.",
    "clock_skew": "The change is small and grows with the time since the recording began.",
}
#: Where stages are shown, and the effects for which that says little.
BY_STAGE: Final = {
    "timing": Shown("air", "position"),
    "command": Shown("air", "position"),
    "actuator": Shown("air", "position"),
    "transmission": Shown("air", "position"),
    "contact": Shown("grasp", "force"),
    "body": Shown("hinge", "position"),
    "joint_sensor": Shown("air", "position"),
    "force_sensor": Shown("grasp", "force"),
}
OTHERS: Final = {
    "velocity_filter": Shown("air", "velocity"),
    "servo_stiffness": Shown("grasp", "force"),
    "torque_constant": Shown("grasp", "force"),
    "force_limit": Shown("grasp", "force"),
    "joint_elasticity": Shown("grasp", "force"),
    "joint_spring": Shown("hinge", "position"),
    "load_dependent_friction": Shown("grasp", "force"),
    "motor_cogging": Shown("air", "velocity"),
    "coupled_motor_friction": Shown("wrist", "position"),
    "coupled_motor_damping": Shown("wrist", "position"),
    "link_centre_y": Shown("wrist", "position"),
    "compliant_mount": Shown("elbow", "position"),
    "object_mass": Shown("push", "force"),
}


def magnitude(p: Parameter, kind: int) -> float:
    """The middle of what a fit tries, on the side of the default.

    Args:
        p: the parameter.
        kind: 0 of a sliding joint, 1 of a hinge.

    Returns:
        Halfway from nothing to the bound; of factors and limits the geometric middle; of a parameter that does nothing
        by itself its default.
    """
    low, high = p.bounds[kind]
    if p.identity is None:
        return p.default[kind]
    if math.isinf(p.identity):
        return math.sqrt(low * high)
    bound = low if p.default[kind] < p.identity else high
    if p.identity == 0:
        return bound / 2
    return math.sqrt(p.identity * bound)


def chosen(name: str) -> tuple[Shown, dict[str, float]]:
    """On what an effect is shown, and its parameters there; shares of a limit as such."""
    declared = EFFECTS[name]
    shown = OTHERS.get(name, BY_STAGE[declared.stage])
    kind = int(shown.motion in motions.ARMS)
    return shown, {key: magnitude(p, kind) for key, p in declared.parameters.items()}


#: Nominal limits in these motions, of which some parameters are shares.
LIMITS: Final = {"effort": 16.0, "velocity": 0.08}


def values(name: str) -> dict[str, float]:
    """The parameters of an effect as they are given to the simulator [SI]."""
    _, magnitudes = chosen(name)
    shares = {key: p.nominal for key, p in EFFECTS[name].parameters.items() if p.nominal}
    return {
        key: float(f"{value * (LIMITS[shares[key]] if key in shares else 1):.3g}") for key, value in magnitudes.items()
    }


@cache
def _nominal(motion: str) -> motions.Recorded:
    return motions.play(motion, None)


def caption(name: str) -> str:
    """What the plot shows, in a sentence."""
    shown, _ = chosen(name)
    kind = int(shown.motion in motions.ARMS)
    parts = []
    for key, value in values(name).items():
        unit = EFFECTS[name].parameters[key].unit[kind]
        parts.append(f"{key.replace('_', ' ')} {value:g}{'' if unit == '-' else f' {unit}'}".replace("-", "−"))
    told = f"{MOTIONS[shown.motion].capitalize()}; {', '.join(parts)}."
    return f"{told} {REMARKS[name]}" if name in REMARKS else told


def draw(name: str) -> str:
    """The plot of an effect as SVG, to stand inside of a page: its text has the colour and the font of the page."""
    shown, _ = chosen(name)
    nominal = _nominal(shown.motion)
    lacking = motions.play(shown.motion, [{"name": name, "parameters": values(name)}])
    before, after = nominal.channels[shown.channel], lacking.channels[shown.channel]
    unit = UNITS[shown.motion, shown.channel]
    style = {"svg.fonttype": "none", "font.size": 11, "text.color": TEXT, "path.simplify_threshold": 0.3}
    with mpl.rc_context(style):
        figure = Figure(figsize=(6.4, 4.2), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        top.plot(nominal.time, before, color=NOMINAL, lw=2.4, label="nominal")
        top.plot(nominal.time, after, color=EFFECT, lw=1.3, label=f"with {name}")
        top.set_ylabel(f"{shown.channel} [{unit}]")
        top.legend(frameon=False, ncols=2, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0)
        bottom.axhline(0, color=NOMINAL, lw=1)
        bottom.plot(nominal.time, after - before, color=EFFECT, lw=1.3)
        bottom.set_ylabel(f"change [{unit}]")
        bottom.set_xlabel("time [s]")
        figure.align_ylabels()
        for axes in (top, bottom):
            axes.set_facecolor("none")
            axes.spines[["top", "right"]].set_visible(False)
            axes.spines[["left", "bottom"]].set_color(TEXT)
            axes.tick_params(colors=TEXT)
            axes.xaxis.label.set_color(TEXT)
            axes.yaxis.label.set_color(TEXT)
            axes.margins(x=0.01)
        written = io.StringIO()
        mpl.rcParams["svg.hashsalt"] = name
        figure.savefig(written, format="svg", transparent=True, metadata={"Date": None})
    return _inline(written.getvalue(), f"{name}: nominal and with the effect. {caption(name)}")


def _inline(svg: str, title: str) -> str:
    """SVG for the inside of a page, in one line: the page's colour and font, its whole width."""
    body = svg[svg.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r"<!--.*?-->", "", body, flags=re.DOTALL)
    body = body.replace(TEXT, "currentColor")
    body = re.sub(r"font: ([\d.]+)px [^;\"]*", r"font-size: \1px", body)
    body = re.sub(r'<svg ([^>]*?)width="[^"]*"', r"<svg \1", body, count=1)
    body = re.sub(r'(<svg [^>]*?)height="[^"]*"', rf'\1role="img" aria-label="{title}"', body, count=1)
    return " ".join(body.split())


def difference(name: str) -> float:
    """Largest change of the channel that an effect is shown on, in its unit."""
    shown, _ = chosen(name)
    lacking = motions.play(shown.motion, [{"name": name, "parameters": values(name)}])
    return float(np.abs(lacking.channels[shown.channel] - _nominal(shown.motion).channels[shown.channel]).max())
