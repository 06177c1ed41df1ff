"""Another engine: the gripper and the object in PyBullet, simulated as the 2021 project did, as recordings.

    python -m benchmarks.blind.bullet --seed 1 --out DIR [--force 16] [--aggregate sum] [--contact-stiffness 10000]

The 2021 project (llach/tiago_rl, read and run) stepped Bullet at 240 Hz, moved the fingers by velocity constraints,
gave the object a contact stiffness of 10 000 N/m and a damping of 100 N·s/m, and took the *mean* normal force of all
contact points of a finger as its reading (the sum, in earlier months). Its URDF's limit of 16 N was never handed to
Bullet. The robot here is this project's own URDF; reading and writing are the blind check's.

What Bullet does otherwise is a gap that nobody made on purpose. Each option is a way to check what a diagnosis says of
it: change it, and what is said must change.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind import cases, motions, reality, recordings, robots
from tiago_mj.models import names, scene
from tiago_mj.models.files import model_file

Array = NDArray[np.float64]

#: The project's physics step [s], and ten of them a command.
STEP: Final = 1 / 240
SUBSTEPS: Final = 10
RATE: Final = 1 / (STEP * SUBSTEPS)
#: What stands for "no limit" [N]: Bullet's own default of a motor's force is of this order.
UNLIMITED: Final = 1000.0


@dataclass(frozen=True)
class Variant:
    """What may be changed to check a diagnosis.

    Attributes:
        force: limit of the motors [N]; the 2021 project had none.
        aggregate: ``sum`` or ``mean`` of the contact points' forces.
        stiffness, damping: of the object's contact [N/m, N·s/m].
        radius, mass: of the object [m, kg].
        offset: of the object towards the left finger [m].
        step: physics step [s].
        iterations: of Bullet's solver; 50 is its default.
    """

    force: float = 16.0
    aggregate: str = "sum"
    stiffness: float = 10_000.0
    damping: float = 100.0
    radius: float = 0.02
    mass: float = 0.421
    offset: float = 0.0
    step: float = STEP
    iterations: int = 50


def simulate(variant: Variant, *, seed: int, trials: int = cases.TRIALS, seconds: float = 10.0) -> cases.Made:
    """A session in Bullet.

    Raises:
        ModuleNotFoundError: PyBullet is not installed; says how to.
    """
    case = cases.Case(seed=seed, trials=trials, seconds=seconds, spread=0.0, placement=0.0, offset=variant.offset)
    robot = cases.real_robot(case, None)
    rows = int(seconds * RATE)
    start = np.full((trials, 2), robot.start[robot.qpos][0])
    setup = reality.Setup("velocity", RATE, rows, np.full(trials, variant.offset), start, seed)
    noise = np.random.default_rng([seed, 0])
    recorded = []
    for k in range(trials):
        program = motions.finger_programs(trials, seed, [motions.Style(softness=0.25)] * trials)[k]
        conductor = motions.Conductor([program], robot, "velocity", start[:1], 1 / RATE)
        recorded.append(_trial(variant, conductor, rows, robot, noise))
    time, commands, position, velocity, force = (np.array(part) for part in zip(*recorded, strict=True))
    return cases.Made(case, robot, reality.Recorded(time, commands, position, velocity, force), setup, servo="ideal")


def _engine() -> Any:
    try:
        import pybullet
    except ModuleNotFoundError as fault:
        raise ModuleNotFoundError(
            "the other engine needs pybullet, which is not installed; install it with: pip install 'tiago-mj[blind]'"
        ) from fault
    return pybullet


def _trial(
    variant: Variant, conductor: motions.Conductor, rows: int, robot: robots.Robot, noise: np.random.Generator
) -> tuple[Array, Array, Array, Array, Array]:
    """One motion in a world of its own: time, commands, positions, velocities, readings."""
    p = _engine()
    client = p.connect(p.DIRECT)
    try:
        hand, item, joints = _world(p, client, variant)
        commands = np.full((rows + 1, 2), np.nan)
        position, velocity, force = (np.zeros((rows + 1, 2)) for _ in range(3))
        per_row = round(1 / (RATE * variant.step))
        for k in range(rows + 1):
            states = p.getJointStates(hand, joints, physicsClientId=client)
            drawn = noise.standard_normal((3, 2))
            position[k] = [s[0] for s in states] + drawn[0] * robots.FINGER_NOISE[0]
            velocity[k] = [s[1] for s in states] + drawn[1] * robots.FINGER_NOISE[1]
            newtons = [_pressed(p, client, hand, item, joint, variant.aggregate) for joint in joints]
            force[k] = np.array(newtons) * robots.UNITS_PER_NEWTON + drawn[2] * robots.FORCE_NOISE
            if k == rows:
                break
            commands[k] = conductor(k, k / RATE, position[k][None], force[k][None])[0]
            p.setJointMotorControlArray(
                hand,
                joints,
                p.VELOCITY_CONTROL,
                targetVelocities=commands[k].tolist(),
                forces=[variant.force] * 2,
                physicsClientId=client,
            )
            for _ in range(per_row):
                p.stepSimulation(physicsClientId=client)
    finally:
        p.disconnect(client)
    return np.arange(rows + 1) / RATE, commands, position, velocity, force


def _pressed(p: Any, client: int, hand: int, item: int, finger: int, aggregate: str) -> float:
    """Normal force on one finger [N]."""
    forces = [c[9] for c in p.getContactPoints(hand, item, finger, physicsClientId=client)]
    if not forces:
        return 0.0
    return float(np.sum(forces) if aggregate == "sum" else np.mean(forces))


def _world(p: Any, client: int, variant: Variant) -> tuple[int, int, list[int]]:
    """Table, object and gripper, where the nominal scene has them: hand, object, finger joints."""
    p.setGravity(0, 0, -9.81, physicsClientId=client)
    p.setTimeStep(variant.step, physicsClientId=client)
    p.setPhysicsEngineParameter(numSolverIterations=variant.iterations, physicsClientId=client)
    table = p.createCollisionShape(p.GEOM_BOX, halfExtents=list(scene.TABLE_HALF), physicsClientId=client)
    p.createMultiBody(0, table, basePosition=list(scene.TABLE_CENTRE), physicsClientId=client)
    height = robots.nominal_object().height
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=variant.radius, height=height, physicsClientId=client)
    middle = cases.real_robot(cases.Case(seed=0, spread=0.0), None)
    place = middle.middle + variant.offset * middle.along
    item = p.createMultiBody(
        variant.mass, shape, basePosition=[*place, scene.TABLE_TOP + height / 2], physicsClientId=client
    )
    p.changeDynamics(
        item,
        -1,
        contactStiffness=variant.stiffness,
        contactDamping=variant.damping,
        lateralFriction=1.0,
        rollingFriction=0.0,
        physicsClientId=client,
    )
    w, x, y, z = scene.GRIPPER_QUATERNION
    turned, _ = p.multiplyTransforms([0, 0, 0], [x, y, z, w], [0, 0, -0.19175], [0, 0, 0, 1])
    base = np.array(scene.GRIPPER_GRASP_POINT) - turned
    urdf = str(model_file("sources/gripper_ta11.urdf"))
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
        p.resetJointState(hand, joint, 0.045, physicsClientId=client)
    return hand, item, joints


def main() -> None:
    """Record a session."""
    parser = argparse.ArgumentParser(description="Record the gripper in PyBullet.")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--trials", type=int, default=cases.TRIALS)
    parser.add_argument("--force", type=float, default=Variant.force, help=f"limit [N]; {UNLIMITED:g}: as in 2021")
    parser.add_argument("--aggregate", choices=("sum", "mean"), default=Variant.aggregate)
    parser.add_argument("--contact-stiffness", type=float, default=Variant.stiffness, help="[N/m]")
    parser.add_argument("--contact-damping", type=float, default=Variant.damping, help="[N·s/m]")
    parser.add_argument("--radius", type=float, default=Variant.radius, help="of the object [m]")
    parser.add_argument("--offset", type=float, default=Variant.offset, help="of the object [m]")
    parser.add_argument("--step", type=float, default=Variant.step, help="of the physics [s]")
    parser.add_argument("--iterations", type=int, default=Variant.iterations, help="of the solver")
    given = parser.parse_args()
    variant = Variant(
        force=given.force,
        aggregate=given.aggregate,
        stiffness=given.contact_stiffness,
        damping=given.contact_damping,
        radius=given.radius,
        offset=given.offset,
        step=given.step,
        iterations=given.iterations,
    )
    made = simulate(variant, seed=given.seed, trials=given.trials)
    recordings.write(made, given.out)
    print(f"{given.trials} trials written to {given.out}")


if __name__ == "__main__":
    main()
