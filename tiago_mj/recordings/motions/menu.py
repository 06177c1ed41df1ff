"""What is on the menu.

Finger motions are for an object about 40 mm wide (36 to 44 mm) that stands between the pads: they begin with the
gripper open, at 45 mm a finger, where the default object is touched at 19.8 mm (pads 2q + 0.4 mm apart). The firmest
presses the set point 4.3 mm into it: 8.6 N from a servo of 2000 N/m (pal_gripper), half of its 16 N. No set point is
faster than 0.05 m/s, which is what the gripper's URDF allows (those of ``position_steps`` jump, by 2 mm at most), nor
nearer than 1 mm to the end of a joint's range, except where it starts there. Arm motions first lift the torso by
0.15 m, away from the table.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tiago_mj.models import names
from tiago_mj.recordings.motions.shapes import Path, Shape, chirp, multisine, start, stop_and_go, wave

#: Where the fingers begin, where they do not touch yet, and where they hardly, well and firmly press [m].
OPEN, NEAR, TOUCH, GRIP, FIRM = 0.045, 0.026, 0.0193, 0.0175, 0.0155
#: Speeds of the set point [m/s].
SLOW, MEDIUM, FAST = 0.005, 0.02, 0.05
#: Rest at the end of every motion [s].
LAST: Final = 0.3


@dataclass(frozen=True)
class Item:
    """A motion of the menu.

    Attributes:
        name: of its files, without rate.
        robot: ``gripper`` (any robot with the two fingers) or ``tiago`` (with torso and arm).
        interface: ``velocity`` or ``position``.
        seconds: how long.
        purpose: which effects it shows, in words.
        shapes: set point by actuator.
    """

    name: str
    robot: str
    interface: str
    seconds: float
    purpose: str
    shapes: Mapping[str, Shape]


def _fingers(name: str, purpose: str, path: Path, shape: Shape | None = None, interface: str = "velocity") -> Item:
    whole = path.hold(LAST)
    return Item(name, "gripper", interface, whole.ends, purpose, dict.fromkeys(names.FINGERS, shape or whole))


def _each(name: str, purpose: str, right: Path, left: Path) -> Item:
    ends = max(right.ends, left.ends) + LAST
    return Item(name, "gripper", "velocity", ends, purpose, dict(zip(names.FINGERS, (right, left), strict=True)))


def _near() -> Path:
    return start(OPEN).to(NEAR, FAST)


def _squeeze(depth: float, speed: float, hold: float) -> Path:
    return _near().to(depth, speed).hold(hold).to(NEAR, FAST)


def _waving(path: Path, seconds: float, signal: Shape) -> tuple[Path, Shape]:
    longer = path.hold(seconds).to(max(NEAR, path.corners[-1][1]), MEDIUM)
    return longer, wave(longer, path.ends, seconds, signal)


def _gripper() -> list[Item]:
    free = start(OPEN).to(0.035, FAST).hold(0.2)
    grip = _near().to(GRIP, MEDIUM).hold(0.3)
    high = (0.4, 0.7, 1.1, 1.7, 2.3, 3.1)
    chirp_free = _waving(free, 4.0, chirp(2e-3, 0.3, 3.0, 4.0))
    chirp_grip = _waving(grip, 4.0, chirp(8e-4, 0.3, 4.0, 4.0))
    sines_free = _waving(free, 4.0, multisine(5e-3, high))
    sines_grip = _waving(grip, 4.0, multisine(2e-3, high))
    moved = start(OPEN).to(0.032, MEDIUM).hold(0.3).to(0.040, MEDIUM).hold(0.3)
    still = start(OPEN)
    right = _near().to(GRIP, MEDIUM).hold(0.4)
    return [
        _fingers("rest", "noise, bias and quantum of every sensor, repeated readings", start(OPEN).hold(2.4)),
        _fingers("squeeze_slow", "contact stiffness, dead band, threshold of the cells", _squeeze(GRIP, SLOW, 0.6)),
        _fingers("squeeze_medium", "the reference grasp, as in the 2021 study", _squeeze(GRIP, MEDIUM, 0.8)),
        _fingers("squeeze_fast", "delay, lag of the cells, contact damping, reflected mass", _squeeze(GRIP, FAST, 0.8)),
        _fingers("squeeze_light", "threshold, bias and dead band at small forces", _squeeze(0.0188, MEDIUM, 0.8)),
        _fingers("squeeze_firm", "gain against saturation, force limit, non-linearity", _squeeze(FIRM, MEDIUM, 0.8)),
        _fingers("ramp_slow", "friction, creep, hysteresis and quantum of the cells under a slowly rising grip",
                 _near().to(0.0205, MEDIUM).to(GRIP, 0.0015).to(0.0205, 0.0015)),
        _fingers("hold_long", "creep and drift of the cells", _squeeze(GRIP, MEDIUM, 8.0)),
        _fingers("hold_levels", "hysteresis of the cells, friction against stiffness: one level from both sides",
                 _near().to(0.0185, MEDIUM).hold(0.8).to(0.0160, MEDIUM).hold(0.8).to(0.0185, MEDIUM).hold(0.8)
                 .to(NEAR, MEDIUM)),
        _fingers("touch_release", "threshold, bias after a touch, size and place of the object",
                 _near().between(TOUCH, NEAR, 0.01, 2, 0.25)),
        _fingers("taps", "lag of the cells, contact damping, restitution", _near().between(0.0185, NEAR, FAST, 6, 0.1)),
        _fingers("impact", "reflected mass, delay, contact damping: from open in one go",
                 start(OPEN).to(0.0185, FAST).hold(0.3).to(OPEN - 1e-3, FAST).hold(0.2).to(0.0185, FAST).hold(0.3)
                 .to(NEAR, FAST)),
        _fingers("release_slow", "hysteresis, stickiness of the pads, backlash on the way back",
                 _near().to(GRIP, MEDIUM).hold(0.4).to(NEAR, SLOW)),
        _fingers("free_reversals_slow", "Coulomb friction against viscous friction, backlash",
                 start(OPEN).between(0.036, 0.041, 0.01, 3)),
        _fingers("free_reversals_fast", "viscous friction, reflected mass, limits of speed",
                 start(OPEN).between(0.028, 0.043, FAST, 5)),
        _fingers("free_sweep", "scale and nonlinearity of the encoders, cogging", start(OPEN).to(0.0275, MEDIUM)
                 .hold(0.2).to(0.0435, MEDIUM)),
        _fingers("small_reversals", "backlash, dead band of the command, stiction: half a millimetre to and fro",
                 start(OPEN).to(0.040, FAST).hold(0.2).between(0.0395, 0.040, SLOW, 8, 0.12)),
        _fingers("steps_free", "delay, stiffness of the servo, limit of speed",
                 start(OPEN).to(0.043, FAST).hold(0.3).to(0.039, FAST).hold(0.3).to(0.031, FAST).hold(0.4)
                 .to(0.039, FAST).hold(0.3).to(0.043, FAST).hold(0.3)),
        _fingers("staircase_free", "stiction, dead band and quantum of the command, quantum of the encoder",
                 start(OPEN).to(0.040, FAST).hold(0.2).stairs(-1e-4, 12, 0.16, SLOW).stairs(1e-4, 6, 0.16, SLOW)),
        _fingers("staircase_grip", "gain and quantum of the cells, stiction under load",
                 _near().to(0.0198, MEDIUM).hold(0.2).stairs(-2e-4, 12, 0.2, SLOW).to(NEAR, MEDIUM)),
        _fingers("chirp_free", "delay, reflected mass and servo damping over frequency", *chirp_free),
        _fingers("chirp_grip", "lag of the cells over frequency, contact damping", *chirp_grip),
        _fingers("multisine_free", "everything of the drive at once, without contact", *sines_free),
        _fingers("multisine_grip", "stiffness and gain at once, in contact", *sines_grip),
        _fingers("stop_and_go", "delay, jitter and loss of commands: moves and stops at irregular instants",
                 stop_and_go(OPEN, -4e-3, 0.16, 24, FAST)),
        _each("right_only", "which finger has it; crosstalk of drives and cells", moved, still),
        _each("left_only", "which finger has it; crosstalk of drives and cells", still, moved),
        _each("shift", "mass and friction of the object: it is held and shifted by a millimetre to either side",
              right.to(GRIP - 1e-3, 0.01).to(GRIP + 1e-3, 0.01).to(GRIP, 0.01).hold(0.3).to(NEAR, MEDIUM),
              right.to(GRIP + 1e-3, 0.01).to(GRIP - 1e-3, 0.01).to(GRIP, 0.01).hold(0.3).to(NEAR, MEDIUM)),
    ]  # fmt: skip


def _position() -> list[Item]:
    """The gripper's motions with their set points sent as positions, as the real gripper takes them; and jumps."""
    steps = start(OPEN)
    for place in (0.043, 0.041, 0.040, 0.0405, 0.040, 0.042):
        steps = steps.step(place).hold(0.4)
    return [
        *(replace(item, name=f"position_{item.name}", interface="position") for item in _gripper()),
        _fingers("position_steps", "delay, servo stiffness and friction: steps of 0.5 to 2 mm", steps,
                 interface="position"),
    ]  # fmt: skip


def _arm() -> list[Item]:
    # Velocities move set points from wherever they are: these begin at 0 for convenience.
    up = start(0.0).to(0.15, FAST).hold(0.4)
    begins = up.ends

    def item(name: str, purpose: str, seconds: float, shapes: Mapping[str, Shape]) -> Item:
        return Item(
            f"arm_{name}", "tiago", "velocity", begins + seconds + LAST, purpose, {names.TORSO[0]: up, **shapes}
        )

    def after(*legs: tuple[float, float, float]) -> Path:
        path = Path(((0.0, 0.0), (begins, 0.0)))
        for place, speed, pause in legs:
            path = path.to(place, speed).hold(pause)
        return path

    sines = (0.15, 0.25, 0.4, 0.55)
    lift = up.to(0.1, 0.02).hold(0.4).to(0.2, 0.06).hold(0.4).to(0.15, 0.02)
    slow = after((-0.12, 0.1, 0.2), (0.0, 0.1, 0.2), (-0.12, 0.1, 0.2), (0.0, 0.1, 0.2))
    quick = after((-0.15, 0.4, 0.3), (0.0, 0.4, 0.3), (-0.15, 0.4, 0.3), (0.0, 0.4, 0.3))
    still = Path(((0.0, 0.0), (begins, 0.0)))
    return [
        Item("arm_lift", "tiago", "velocity", lift.ends + LAST, "friction of the torso, payload",
             {names.TORSO[0]: lift}),
        item("reversals_slow", "Coulomb friction of the arm against payload and tilt", slow.ends - begins,
             dict.fromkeys(names.ARM[:4], slow)),
        item("reversals_fast", "viscous friction, reflected inertia and elasticity of the arm", quick.ends - begins,
             dict.fromkeys(names.ARM[:4], quick)),
        item("wrist", "friction and delay of the wrist", quick.ends - begins, dict.fromkeys(names.ARM[4:], quick)),
        item("multisine", "everything of the arm at once", 6.0,
             {name: wave(still, begins, 6.0, _scaled(multisine(0.12, sines), k)) for k, name in
              enumerate(names.ARM[1:4])}),
    ]  # fmt: skip


def _scaled(signal: Shape, shift: int) -> Shape:
    """The same motion later, so that joints do not move in step."""
    return lambda t: np.asarray(signal(t + 0.7 * shift))


def items() -> tuple[Item, ...]:
    """The whole menu."""
    return (*_gripper(), *_position(), *_arm())
