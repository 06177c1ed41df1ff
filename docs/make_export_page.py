"""Write docs/export.md from what the targets declare: `python docs/make_export_page.py`."""

from pathlib import Path

from tiago_mj.export import holding
from tiago_mj.export.targets.registry import TARGETS

PAGE = Path(__file__).parent / "export.md"
HEAD = """\
# Export to other simulators

`tiago-mj export` writes what a diagnosis found for MuJoCo 3.11, 3.17 and 4.0, for
mjlab, MuJoCo Playground, Isaac Lab and Newton, as limits of ros2_control, as URDF and as SDF. This page is written by
`python docs/make_export_page.py` from the declarations of the targets.

```sh
tiago-mj export out/pendulum/diagnosis --model out/pendulum/pendulum.xml --out exported/mujoco
tiago-mj export out/pendulum/diagnosis --model out/pendulum/pendulum.xml --to isaaclab --out exported/isaaclab
tiago-mj export --table
```

The folder gets the files of the target, `export.md` with a table that says for each effect whether the target can hold
it, and `changes.diff`. Without `--model` the model is looked for beside the diagnosis.

## MuJoCo

The model's own text is edited, not compiled and saved: comments, names, classes, includes and `position` actuators
stay, and one joint's friction is one changed line. Files that are included or referred to are copied along.

- `--mujoco 3.11` or `3.17` refuses, in one line, elements of your file that this version does not know, by the
  version's own schema. Delays are written as `delay` and `nsample`, which both versions have. Before 3.15 `dampratio`
  meant another damping, so `kv` is written instead.
- *Backlash* becomes a second joint in the body, as the manual describes (Modeling, "Backlash"): the actuator turns the
  first, which keeps its name; the second has a range of the backlash's width; a tendon over both has the friction,
  damping, armature, range and sensors that the joint had. Keyframes get a value for the second joint. A spring between
  motor and joint is written in the same way. A motor that is declared without inertia gets the smallest inertia that is
  stable at the physics step. That is large where the servo's damping is strong: with 10 mrad of backlash in the elbow
  of Menagerie's UR5e the file leaves 14 % of the mean squared gap at a step of 2 ms, 6 % at 1 ms and 1.6 % at 0.5 ms.
- The physics step of the file stays as it is. The recordings are replayed with the file, and the share of the gap that
  it closes is printed.

Exported files were replayed in older versions, on an arm of three joints, and compared with this package's own
simulation of the effects: dry and viscous friction, servo gains and limits, payload and tilt, delay, backlash,
elasticity. The share of the gap that MuJoCo 3.11 and 3.17 close is within 1 % of that of 4.0: all of it where the
table says *exact*, 98 % or more for backlash and elasticity. MJX 3.17 closes as much for friction, payload and
backlash, and ignores delays; MuJoCo Warp 3.11, mjlab's engine, closes as much for friction and backlash. Where a
spring is written as lower gains, these close 86 to 97 % on the same arm, in MuJoCo.

## Domain randomisation

`--randomisation` writes, beside the rest, simulators that are drawn from the diagnosis's posterior as
[`train --randomise`](learning.md#randomisation-from-a-diagnosis) draws them. DIAGNOSIS has to be the folder with
`diagnosis.json`.

```sh
tiago-mj export out/pendulum/diagnosis --model out/pendulum/pendulum.xml --to mjlab --randomisation --out exported/mjlab
```

- `mjlab`: `mjlab_events.py`, whose `EVENTS` has an `EventTermCfg` that gives a world one row of `draws.json` at each
  reset. `isaaclab`: `isaaclab_events.py`, whose `EventCfg` has an `EventTerm` that does the same.
- `playground`: `playground_randomisation.py`, whose `randomizer(mj_model)` is a `randomization_fn`: environments get a
  row each at the start.
- `gymnasium`: `posterior.json` and `simulators.py`, whose `draw_effects` is the argument of that name of
  `gymnasium.make_vec`.
- `mujoco`, `newton`, `ros2_control`, `urdf` and `sdf` have one number for each and no distributions: their table says
  so.

`draws.json` has 500 simulators as numbers of the robot's model, not ranges. A row is one draw, so that numbers that
depend on each other stay together, explanations keep their probabilities, and bounds hold. What a target can only draw
by itself, such as delays of mjlab and Isaac Lab, gets the ends of its 90 % interval in physics steps; the correlation
with the others is lost there, and the table says so. Effects on readings, commands and contacts are no numbers of a
robot's model: they are not drawn there.

The events ran behind stand-ins for mjlab, Isaac Lab and JAX, which check every value that is written; they were not
run in these packages. The functions that they call are those of mjlab 1.6.0 and Isaac Lab 2.3.

## Which target holds what

*exact*: the same number in the same law. *approx.*: in another form, or only nearly; the lists below say how. *–*: not
held; the lists below say why. `model/` among a target's files is the MJCF of the section above.

"""
NUMBERS = """\

## How each target holds an effect, or why not

Numbers are at the joints and in SI units, N·m and radians on hinges, N and metres on slides; USD has stiffness, damping
and speeds of hinges per degree. Each target's section says what was tried with the real package.

"""
UNKNOWN = "Effects of your own are held only by `gymnasium` and `tiago_mj.gap.apply`.\n"


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
