"""Another engine: the gripper and the object in PyBullet, simulated as the 2021 project did, as recordings.

    python -m benchmarks.blind.bullet --seed 1 --out DIR [--force 16] [--aggregate sum] [--stiffness 5000] ...

The 2021 project (llach/tiago_rl at its released cc5ce92, read and run) stepped Bullet at 240 Hz with a command a step,
moved the fingers by velocity constraints whose force it never limited (the URDF's 16 N were not handed over), gave the
object's contacts 10 000 N/m and 100 N·s/m, and took the *mean* normal force of a finger's contact points for its
reading (two months earlier, d535ba2: the sum). All that is here. What differs: the robot is this project's own URDF at
its own table; readings are in the units of the real load cells; the encoders, which were exact there, have the noise of
the real ones; the object has the 0.421 kg that it was measured to have, as until August 2021 (2 kg later).

What Bullet does otherwise is a gap that nobody made on purpose. Each option is a way to check what a diagnosis says of
it: change it, and what is said must change.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind import cases, motions, reality, recordings, robots
from tiago_mj.io import extra
from tiago_mj.models import names, scene
from tiago_mj.models.files import model_file

Array = NDArray[np.float64]

#: The 2021 project's physics step [s].
STEP: Final = 1 / 240
#: Seconds of a trial unless told.
SECONDS: Final = 2.0
#: A finger whose velocity is a constraint has only the contact to yield: depths and gains over a soft servo's.
SOFTNESS: Final = 0.25
#: Clear width between the pads at joint positions of zero [m]; our URDF.
CLEAR: Final = 4e-4
#: Opening at which long trials begin [m].
OPEN: Final = 0.045
#: A pad counts as pressed from here on [N]: for what a simulation says of itself.
PRESSED: Final = 4.0


@dataclass(frozen=True)
class Variant:
    """What may be changed to check a diagnosis; the defaults are the released 2021 project's.

    Attributes:
        force: limit of the motors [N]; None: Bullet is given none.
        gain: share of the error in velocity that the motors remove in a step.
        aggregate: ``mean`` or ``sum`` of the contact points' forces.
        stiffness, damping: of each point of the object's contacts [N/m, N·s/m].
        friction, rolling: of the object's surface.
        radius, mass: of the object [m, kg].
        offset: of the object towards the left finger [m]; the user knows it.
        moved: the same, unknown to the user [m].
        step: physics step [s].
        iterations: of Bullet's solver, at most; 50 is its default.
        residual: squared change of an iteration below which Bullet's solver leaves off; 1e-7 is its default.
        rate: of control [Hz].
    """

    force: float | None = None
    gain: float = 1.0
    aggregate: str = "mean"
    stiffness: float = 10_000.0
    damping: float = 100.0
    friction: float = 1.0
    rolling: float = 1.0
    radius: float = 0.02
    mass: float = 0.421
    offset: float = 0.0
    moved: float = 0.0
    step: float = STEP
    iterations: int = 50
    residual: float = 1e-7
    rate: float = 1 / STEP

    @property
    def substeps(self) -> int:
        """Physics steps of a command.

        Raises:
            ValueError: they are not a whole number.
        """
        steps = 1 / (self.rate * self.step)
        if abs(steps - round(steps)) > 1e-6 * steps or round(steps) < 1:
            raise ValueError(
                f"a command at {self.rate:g} Hz lasts {steps:g} physics steps of {self.step:g} s: "
                "choose a rate and a step that make a whole number"
            )
        return round(steps)


def simulate(
    variant: Variant,
    *,
    seed: int,
    trials: int = cases.TRIALS,
    seconds: float = SECONDS,
    servo: str = "ideal",
    programs: list[motions.Program] | None = None,
) -> cases.Made:
    """A session in Bullet.

    Args:
        variant: what is simulated.
        seed: of motions and noise: two variants of one seed differ in nothing else.
        trials, seconds: of the session.
        servo: what the sidecars tell the user of the fingers' servos: ``ideal`` or ``pal``.
        programs: motions, one a trial; None: those of the blind check's gripper.

    Returns:
        The recordings; in ``truth`` what no user can see, over all rows where both pads are pressed: ``points`` that
        carry force and the whole ``force`` [N], means by pad, and ``stiffness``, force over approach [N/m].

    Raises:
        ModuleNotFoundError: PyBullet is not installed; says how to.
        ValueError: a command is no whole number of physics steps.
    """
    case = cases.Case(
        seed=seed,
        trials=trials,
        seconds=seconds,
        rate=variant.rate,
        spread=0.0,
        placement=0.0,
        offset=variant.offset,
    )
    robot = cases.real_robot(case, None)
    rows = round(seconds * variant.rate)
    short = seconds <= cases.SHORT  # then there is no time to close from far
    draw = np.random.default_rng([seed, 9])
    opened = draw.uniform(*cases.NEAR, trials) if short else np.full(trials, OPEN)
    pace = seconds / cases.LONG if short else 1.0
    styles = [motions.Style(SOFTNESS, pace, float(at)) for at in opened]
    programs = programs or motions.finger_programs(trials, seed, styles)
    start = np.tile(opened[:, None], (1, 2))
    setup = reality.Setup("velocity", variant.rate, rows, np.full(trials, variant.offset), start, seed)
    noise = np.random.default_rng([seed, 0])
    recorded, pressed = [], []
    for k in range(trials):
        conductor = motions.Conductor([programs[k]], robot, "velocity", start[k : k + 1], 1 / variant.rate)
        signals, facts = _trial(variant, conductor, rows, robot, float(opened[k]), noise)
        recorded.append(signals)
        pressed.append(facts)
    made = reality.Recorded(*(np.array(part) for part in zip(*recorded, strict=True)))
    return cases.Made(case, robot, made, setup, _truth(np.concatenate(pressed)), servo=servo)


def _truth(pressed: Array) -> dict[str, Any]:
    """Of rows in which both pads are pressed, (n, 3, 2): points, forces and depths by pad."""
    if not len(pressed):
        return {}
    points, newtons, depth = pressed.transpose(1, 0, 2)
    return {
        "points": dict(zip(names.SIDES, points.mean(axis=0).round(3).tolist(), strict=True)),
        "force": dict(zip(names.SIDES, newtons.mean(axis=0).round(3).tolist(), strict=True)),
        "stiffness": round(float(np.median(newtons / depth)), 1),
    }


def _engine() -> Any:
    return extra.load("pybullet", "the other engine", "blind")


@contextmanager
def _silent() -> Iterator[None]:
    """Bullet tells every link that it merges, past Python's own streams."""
    kept = [os.dup(stream) for stream in (1, 2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for stream in (1, 2):
            os.dup2(nowhere, stream)
        yield
    finally:
        for stream, copy in zip((1, 2), kept, strict=True):
            os.dup2(copy, stream)
            os.close(copy)
        os.close(nowhere)


def _trial(
    variant: Variant,
    conductor: motions.Conductor,
    rows: int,
    robot: robots.Robot,
    opened: float,
    noise: np.random.Generator,
) -> tuple[tuple[Array, ...], Array]:
    """One motion in a world of its own: time, commands, positions, velocities, readings; points, forces, depths."""
    p = _engine()
    client = p.connect(p.DIRECT)
    try:
        hand, item, joints = _world(p, client, variant, robot, opened)
        motors: dict[str, Any] = {"velocityGains": [variant.gain] * 2, "physicsClientId": client}
        if variant.force is not None:
            motors["forces"] = [variant.force] * 2
        commands = np.full((rows + 1, 2), np.nan)
        position, velocity, force = (np.zeros((rows + 1, 2)) for _ in range(3))
        pressed = []
        for k in range(rows + 1):
            states = p.getJointStates(hand, joints, physicsClientId=client)
            q = np.array([s[0] for s in states])
            drawn = noise.standard_normal((3, 2))
            position[k] = q + drawn[0] * robots.FINGER_NOISE[0]
            velocity[k] = [s[1] for s in states] + drawn[1] * robots.FINGER_NOISE[1]
            points = [[c[9] for c in p.getContactPoints(hand, item, j, physicsClientId=client)] for j in joints]
            newtons = [
                sum(loads) / (len(loads) if variant.aggregate == "mean" else 1) if loads else 0.0 for loads in points
            ]
            force[k] = np.array(newtons) * robots.UNITS_PER_NEWTON + drawn[2] * robots.FORCE_NOISE
            depth = (2 * variant.radius - CLEAR - q.sum()) / 2  # of each pad, once the object is between them
            whole = [sum(loads) for loads in points]
            if depth > 0 and min(whole) > PRESSED:
                pressed.append(([sum(f > 0 for f in loads) for loads in points], whole, [depth, depth]))
            if k == rows:
                break
            commands[k] = conductor(k, k / variant.rate, position[k][None], force[k][None])[0]
            p.setJointMotorControlArray(
                hand, joints, p.VELOCITY_CONTROL, targetVelocities=commands[k].tolist(), **motors
            )
            for _ in range(variant.substeps):
                p.stepSimulation(physicsClientId=client)
    finally:
        p.disconnect(client)
    return (np.arange(rows + 1) / variant.rate, commands, position, velocity, force), np.array(
        pressed, dtype=float
    ).reshape(-1, 3, 2)


def _world(p: Any, client: int, variant: Variant, robot: robots.Robot, opened: float) -> tuple[int, int, list[int]]:
    """Table, object and gripper, where the nominal scene has them: hand, object, finger joints."""
    p.setGravity(0, 0, -9.81, physicsClientId=client)
    p.setTimeStep(variant.step, physicsClientId=client)
    p.setPhysicsEngineParameter(
        numSolverIterations=variant.iterations, solverResidualThreshold=variant.residual, physicsClientId=client
    )
    table = p.createCollisionShape(p.GEOM_BOX, halfExtents=list(scene.TABLE_HALF), physicsClientId=client)
    p.createMultiBody(0, table, basePosition=list(scene.TABLE_CENTRE), physicsClientId=client)
    height = robots.nominal_object().height
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=variant.radius, height=height, physicsClientId=client)
    place = robot.middle + (variant.offset + variant.moved) * robot.along
    item = p.createMultiBody(
        variant.mass, shape, basePosition=[*place, scene.TABLE_TOP + height / 2], physicsClientId=client
    )
    p.changeDynamics(
        item,
        -1,
        contactStiffness=variant.stiffness,
        contactDamping=variant.damping,
        lateralFriction=variant.friction,
        rollingFriction=variant.rolling,
        physicsClientId=client,
    )
    w, x, y, z = scene.GRIPPER_QUATERNION
    turned, _ = p.multiplyTransforms([0, 0, 0], [x, y, z, w], [0, 0, -0.19175], [0, 0, 0, 1])
    base = np.array(scene.GRIPPER_GRASP_POINT) - turned
    urdf = str(model_file("sources/gripper_ta11.urdf"))
    with _silent():
        hand = p.loadURDF(
            urdf,
            base.tolist(),
            [x, y, z, w],
            useFixedBase=True,
            flags=p.URDF_MERGE_FIXED_LINKS,  # load cell and tip become part of their finger
            physicsClientId=client,
        )
    index = {}
    for j in range(p.getNumJoints(hand, physicsClientId=client)):
        index[p.getJointInfo(hand, j, physicsClientId=client)[1].decode()] = j
    joints = [index[name] for name in names.FINGERS]
    for joint in joints:
        p.resetJointState(hand, joint, opened, physicsClientId=client)
    return hand, item, joints


def main() -> None:
    """Record a session."""
    parser = argparse.ArgumentParser(
        description="Record the gripper in PyBullet; Variant explains what can be changed."
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--trials", type=int, default=cases.TRIALS)
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--servo", choices=scene.SERVOS, default="ideal", help="what the sidecars say of the servos")
    for field in fields(Variant):
        kind: Any = {"aggregate": str, "iterations": int}.get(field.name, float)
        choices = ("mean", "sum") if field.name == "aggregate" else None
        parser.add_argument(f"--{field.name}", type=kind, choices=choices, default=field.default)
    given = vars(parser.parse_args())
    variant = Variant(**{name: given[name] for name in asdict(Variant())})
    made = simulate(variant, seed=given["seed"], trials=given["trials"], seconds=given["seconds"], servo=given["servo"])
    recordings.write(made, given["out"])
    print(f"{given['trials']} trials written to {given['out']}; of what is in contact: {made.truth}")


if __name__ == "__main__":
    main()
