"""Write docs/export.md from what the targets declare: `python docs/make_export_page.py`."""

from pathlib import Path

from tiago_mj.export import holding
from tiago_mj.export.targets.registry import TARGETS

PAGE = Path(__file__).parent / "export.md"
HEAD = """\
# Export to other simulators

What a diagnosis found is of use wherever you train. `tiago-mj export` writes it for MuJoCo 3.11, 3.17 and 4.0, for
mjlab, MuJoCo Playground, Isaac Lab and Newton, as limits of ros2_control, as URDF and as SDF. This page is written by
`python docs/make_export_page.py` from what the targets declare.

```sh
tiago-mj export out/pendulum/diagnosis --model out/pendulum/pendulum.xml --out exported/mujoco
tiago-mj export out/pendulum/diagnosis --model out/pendulum/pendulum.xml --to isaaclab --out exported/isaaclab
tiago-mj export --table
```

Into the folder go the files of the target, `export.md` with a table of what the target holds of each effect and what
not, and `changes.diff`. The model is looked for beside the diagnosis where `--model` does not say where it is.

## MuJoCo

The model's own text is edited, not compiled and saved: comments, names, classes, includes and `position` actuators
stay, and one joint's friction is one changed line. Files that are included or referred to are copied along.

- `--mujoco 3.11` or `3.17` refuses, in one line, what the user's file has and that version does not know, by the
  versions' own schemas. Delays are written as `delay` and `nsample`, which both versions have. Before 3.15 `dampratio`
  meant another damping, so that `kv` is written for it.
- *Play* becomes a second joint in the body, as the manual has it (Modeling, "Backlash"): the actuator turns the first,
  which keeps its name; the second has a range of the play's width; a tendon over both has the friction, damping,
  armature, range and sensors that the joint had. Keyframes are lengthened. A spring between motor and joint is written
  in the same way. A motor that is said to have no mass is given as little as the physics step bears, which is much
  where the servo's damping is strong: of 10 mrad of play in the elbow of Menagerie's UR5e the file leaves 14 % of the
  mean squared gap at a step of 2 ms, 6 % at 1 ms and 1.6 % at 0.5 ms.
- The physics step of the file stays as it is. How far the file closes the gap is replayed and printed.

What was replayed in the older versions, on an arm of three joints, beside this package's own simulation of the
effects: dry and viscous friction, servo gains and limits, payload and tilt, delay, play, elasticity. The share of the
gap that MuJoCo 3.11 and 3.17 close is within 1 % of what 4.0 closes: all of it where the table says *exact*, 98 % or
more of play and elasticity. MJX 3.17 closes as much of friction, payload and play, and ignores delays; MuJoCo Warp
3.11, mjlab's engine, as much of friction and play. Where a spring is written as lower gains, these close 86 to 97 % on
the same arm, in MuJoCo.

## Which target holds what

*exact*: the same number in the same law. *approx.*: in another form, or only nearly; the lists below say how. *–*: not
held, and why. `model/` beside a target's text is the MJCF of the section above.

"""
NUMBERS = """\

## How, and why not

Numbers are at the joints and in SI units, N·m and radians on hinges, N and metres on slides; USD has stiffness, damping
and speeds of hinges per degree. What was tried with the real package is said with each.

"""
UNKNOWN = "An effect of your own is taken for its stage: not held but by `gymnasium` and `tiago_mj.gap.apply`.\n"


def page() -> str:
    """The page's text."""
    effects = holding.library()
    every = {name: target.holds for name, target in TARGETS.items()}
    reasons = holding.reasons(every, effects)
    for name, target in TARGETS.items():
        title = f"### `{name}`\n"
        reasons = reasons.replace(title, f"{title}\nVersion {target.version}: {target.tried}.\n", 1)
    return HEAD + holding.table(every, effects) + NUMBERS + reasons + UNKNOWN


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
