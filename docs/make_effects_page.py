"""Write docs/effects.md from the declarations: `python docs/make_effects_page.py`."""

import math
from pathlib import Path

from tiago_mj.effects import EFFECTS, describe
from tiago_mj.effects.declare import STAGES, Effect, twins
from tiago_mj.effects.fields import Detail, Parameter

PAGE = Path(__file__).parent / "effects.md"
SOURCES = {
    "BAM": "the *Better Actuator Models* of Rhoban/bam: parameters fitted to servos of several sizes",
    "PACE": "delays of a bus loop that PACE fitted to legged robots",
    "so101": "recordings of a LeRobot SO-101, isaac-sim2real/sage",
    "tiago_arm": "a recording of TIAGo's arm, thanhndv212/figaroh-plus",
    "staubli_TX40": "friction of a Stäubli TX40, whose last motor turns with joints 5 and 6, thanhndv212/figaroh-plus",
    "pal_gripper": "pal-robotics/pal_gripper: the fingers' URDF and controller gains",
    "menagerie": "google-deepmind/mujoco_menagerie, `pal_tiago`",
    "regressions": "mass, friction and constants of real robots, `benchmarks/real/regression.py`",
    "Rapp 1991": "amplifiers, in *Effects of HPA-nonlinearity on a 4-DPSK/OFDM-signal*; its p is 1 / (2 softness)",
    "force_vs_displacement": "forces of a real gripper with TA11 load cells over displacement, llach/learning_fc",
}
HEAD = """\
# Effects

{count} effects that a real robot has and the nominal simulator lacks, from a late command to a drifting load cell. The
environments simulate them, so that a policy can be trained on a simulator that has the real robot's faults; the
diagnosis (`tiago-mj diagnose`) says which of them a recording shows, with the same code. This page is written from
their declarations by `python docs/make_effects_page.py`: edit those.

## How they are used

As a list, with what each acts on and its parameters:

```python
import gymnasium
import tiago_mj

effects = [
    {{"name": "coulomb_friction", "target": "gripper_left_finger_joint", "parameters": {{"force": 2.5}}}},
    {{"name": "force_lag"}},
]
env = gymnasium.make("tiago_mj/GripperTactile-v0", effects=effects)
```

- `target` is a name, a list of names, or `"all"`, which is the default; one entry's values serve all of its targets,
  different values need two entries. A payload's default is the tool.
- Parameters left out take their defaults: a magnitude that is clearly visible, not a typical one.
- A value may lie beyond what a fit tries, as large robots have it; ten times beyond is refused, with the likely mistake
  (mm for m, ms for s). What a diagnosis found is taken as it is.
- Two entries of one effect on one target add up, factors multiply, and of two limits the tighter holds.

As a mapping, the short form: every effect on all of its targets, `{{}}` for the defaults.

```python
import gymnasium
import tiago_mj

env = gymnasium.make("tiago_mj/GripperTactile-v0", effects={{"command_delay": {{"seconds": 0.03}}, "backlash": {{}}}})
```

As the `calibration.yaml` that a diagnosis writes: `effects="calibration.yaml"` is the repaired simulator. It has an
interval beside every value; the simulator takes the values. `numbers:`, where a diagnosis confirmed some, are the
nominal model's own as fitted ([numbers as fitted](reading-a-report.md#numbers-as-fitted)): they act beside the effects.

```yaml
schema: tiago_mj.calibration/1
robot: tiago_mj/GripperTactile-v0
effects:
  - name: coulomb_friction
    target: gripper_left_finger_joint
    parameters: {{force: {{value: 2.5, low: 2.1, high: 2.9}}}}
source: {{file: diagnosis.json}}
```

```sh
tiago-mj record --env GripperTactile-v0 --policy pi --episodes 10 --effects calibration.yaml --out recordings
```

At its *identity* an effect changes nothing, to the last bit. *Bounds* are what a fit tries; values beyond them can be
simulated, impossible ones (a negative time, a probability of 2) are refused. Friction, damping, mass and inertia are
*additional* to the nominal and may be negative, down to minus the nominal: reality can have less.

Your own effect takes 15 lines: see [its page](own-effect.md).

## Targets

| target | acts on | names |
|---|---|---|
| `command` | actuators | as the joints: `gripper_right_finger_joint`, `arm_3_joint`, … |
| `joint` | joints | the same |
| `sensor` | load cells | `right`, `left` |
| `object`, `clock` | the object, the recorder's clock | there is only one |

## Stages

The signal chain, in the order in which effects act; a diagnosis says in which of them the gap lies.

{stages}

## Classes

Effects of one class look alike in many recordings. A diagnosis names the best one, and lists the others where the data
cannot tell them apart. Every other effect is a class of its own.

{classes}

## Sources

Typical magnitudes are from the sources below. *Chosen* means that a number is not measured: it is what the
project's authors consider usual.

{sources}
"""
ABOUT = {
    "timing": "when a measurement is said to have been made",
    "command": "from the command that was sent to the set point that the servo takes",
    "actuator": "servo and motor, from the set point to a force on the joint",
    "transmission": "friction, play, springs and inertia between motor and joint",
    "contact": "the object between the pads",
    "body": "masses, gravity and what the base stands on",
    "joint_sensor": "from where a joint is to what is read",
    "force_sensor": "from the force on a pad to a reading",
}


def number(value: float | None) -> str:
    """A number as it is written in a table; a dash where there is none."""
    if value is None:
        return "–"
    return "∞" if math.isinf(value) else f"{value:g}".replace("-", "−")


def pair(values: tuple[str, str]) -> str:
    """What differs between a sliding joint and a hinge is written as a pair."""
    return values[0] if values[0] == values[1] else f"{values[0]}; {values[1]}"


def row(p: Parameter) -> str:
    """A parameter as a row of its effect's table."""
    of = "" if p.nominal is None else f" of the nominal {p.nominal}"
    default = pair((number(p.default[0]), number(p.default[1]))) + of
    ranges = [f"{number(low)} to {number(high)}" for low, high in p.bounds]
    bounds = pair((ranges[0], ranges[1])) + of
    unit = pair(p.unit).replace("-", "–")
    return f"| `{p.name}` | {unit} | {number(p.identity)} | {default} | {bounds} |"


def more(detail: Detail) -> str:
    """A number that says more of an effect, as a row of its table."""
    low, high = (number(bound) for bound in detail.bounds)
    unit = pair(detail.unit).replace("-", "–")
    return f"| `{detail.name}` | {unit} | 0 | 0 | {low} to {high} |"


def section(name: str, declared: type[Effect]) -> str:
    """An effect's part of the page."""
    told = describe(declared)
    shared = "" if declared.gap_class == name else f" · class *{declared.gap_class}*"
    parts = [
        f"### `{name}`",
        f"{told.what.replace('``', '`')}",
        f"Acts on: `{declared.targets}`{shared}",
        f"    {told.formula}",
        "| parameter | unit | identity | default | bounds |\n|---|---|---|---|---|\n"
        + "\n".join([*map(row, declared.parameters.values()), *map(more, declared.details.values())]),
    ]
    said = [
        ("In a recording", told.looks),
        ("Typical", f"{told.typical} *Source:* {told.source}"),
        ("On the robot", told.check),
        ("MuJoCo", told.native or "has none; it is computed outside of the simulation."),
    ]
    if twins(name):
        said.insert(2, ("Hardly told from", ", ".join(map(link, twins(name)))))
    parts.append("\n".join(f"- *{label}:* {text.replace('``', '`')}" for label, text in said))
    return "\n\n".join(parts)


def page() -> str:
    """The whole page, of the library's own effects."""
    own = {name: declared for name, declared in EFFECTS.items() if declared.__module__.startswith("tiago_mj.")}
    stages = "\n".join(
        f"{k}. *{stage}*, {ABOUT[stage]}: {', '.join(link(n) for n, d in own.items() if d.stage == stage)}"
        for k, stage in enumerate(STAGES, start=1)
    )
    groups = {d.gap_class: [n for n, other in own.items() if other.gap_class == d.gap_class] for d in own.values()}
    classes = "\n".join(
        f"- *{group}*: {', '.join(link(name) for name in members)}"
        for group, members in groups.items()
        if len(members) > 1
    )
    sources = "\n".join(f"- *{name}*: {what}" for name, what in SOURCES.items())
    text = [HEAD.format(count=len(own), stages=stages, classes=classes, sources=sources)]
    for stage in STAGES:
        text.append(f"## {stage.replace('_', ' ').capitalize()}: {ABOUT[stage]}\n")
        text += [section(name, declared) + "\n" for name, declared in own.items() if declared.stage == stage]
    return "\n".join(text)


def link(name: str) -> str:
    """To an effect's part of the page."""
    return f"[{name}](#{name})"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
