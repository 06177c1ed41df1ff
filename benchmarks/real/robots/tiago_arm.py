"""A real TIAGo's arm along an excitation motion of 80 s (thanhndv212/figaroh-plus): positions and motor efforts.

One recording serves both sides: seconds 0 to 10, 20 to 30, 40 to 50 and 60 to 70 are diagnosed, the four other tens of
seconds gave the truth by regression. The nominal model is this package's TIAGo, whose joints have 1 N·m and
1 N·m·s/rad as the manufacturer's URDF says; what is found is added to them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from benchmarks.real import signals
from benchmarks.real.declare import EFFORTS, NOTHING, REGRESSION, WHOLE, Case, Cause, File, Source
from benchmarks.real.logs import Array, Log, log
from tiago_mj.models.files import model_file
from tiago_mj.recordings.imports import tiago_arm

ROBOT: Final = tiago_arm.ROBOT
JOINTS: Final = tiago_arm.JOINTS
#: Whose efforts can be used.
RUBBING: Final = JOINTS[1:5]
SOURCE: Final = Source(
    "tiago_arm",
    tiago_arm.DATA.repository,
    tiago_arm.DATA.commit,
    tiago_arm.DATA.licence,
    tuple(
        File(f"tiago_arm/{name}", f"{tiago_arm.DATA.path}/{name}", digest)
        for name, digest in tiago_arm.DATA.sha256.items()
    ),
)
FILES: Final = tuple(file.place for file in SOURCE.files)
DIAGNOSED: Final = ((0.0, 10.0), (20.0, 30.0), (40.0, 50.0), (60.0, 70.0))
DERIVED: Final = ((10.0, 20.0), (30.0, 40.0), (50.0, 60.0), (70.0, 80.0))
#: Of the URDF, on every joint of the arm [N·m], [N·m·s/rad].
STATED: Final = 1.0
#: In all, by regression: Coulomb [N·m], viscous [N·m·s/rad].
COULOMB: Final = (1.84, 3.98, 2.81, 2.28)
VISCOUS: Final = (29.5, 15.7, 4.94, 4.17)


def _logs(data: Path) -> list[Log]:
    whole = next(iter(tiago_arm.trials(str(data / "tiago_arm"))))
    made = []
    for begin, end in DIAGNOSED:
        rows = (whole.time >= begin) & (whole.time < end)
        made.append(
            log(
                f"tiago-{begin:02.0f}s",
                whole.time[rows],
                position={joint: values[rows] for joint, values in whole.positions.items()},
                velocity={joint: values[rows] for joint, values in whole.velocities.items()},
                effort={joint: whole.efforts[joint][rows] for joint in RUBBING},
                robot=ROBOT,
                rate_hz=100,
                initial={"position": {joint: float(values[rows][0]) for joint, values in whole.positions.items()}},
            )
        )
    return made


def _weightless_joints() -> mujoco.MjModel:
    arm = mujoco.MjModel.from_xml_path(str(model_file(f"robots/{ROBOT}.xml")))
    arm.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    arm.dof_damping[:] = arm.dof_frictionloss[:] = arm.dof_armature[:] = 0.0
    arm.body_gravcomp[:] = 0.0
    return arm


def friction(data: Path, parts: Sequence[tuple[float, float]] = DERIVED) -> dict[str, float]:
    """Friction of arm_1 to arm_4 over parts of the recording; a share of the rigid torque is fitted along, as neither
    the payload nor the motors' constants are known."""
    whole = next(iter(tiago_arm.trials(str(data / "tiago_arm"))))
    position = np.stack([whole.positions[joint] for joint in JOINTS], axis=1)
    effort = np.stack([whole.efforts[joint] for joint in JOINTS], axis=1)
    motion = signals.motion(whole.time, position, effort, rate=100.0, cutoff=4.0)
    arm = _weightless_joints()
    at: Any = [arm.joint(joint).qposadr[0] for joint in JOINTS]
    dof: Any = [arm.joint(joint).dofadr[0] for joint in JOINTS]
    state = mujoco.MjData(arm)
    needed: Array = np.zeros_like(motion.position)
    for row in range(len(needed)):
        state.qpos[at], state.qvel[dof], state.qacc[dof] = (
            x[row] for x in (motion.position, motion.velocity, motion.acceleration)
        )
        mujoco.mj_inverse(arm, state)
        needed[row] = state.qfrc_inverse[dof]
    rows = np.any([(motion.time >= low) & (motion.time < high) for low, high in parts], axis=0)
    out: dict[str, float] = {}
    for joint in RUBBING:
        k = JOINTS.index(joint)
        speed, torque = motion.velocity[rows, k], motion.beside[rows, k]
        found = signals.fit(
            {
                "viscous": speed,
                "coulomb": signals.turning(speed, 0.02),
                "armature": motion.acceleration[rows, k],
                "offset": np.ones_like(speed),
                "rigid": needed[rows, k],
            },
            torque,
        )
        out |= {f"{joint}.{name}": value for name, value in found.values.items()}
        out[f"{joint}.explained"] = found.explained
    return out


def regress(data: Path) -> dict[str, float]:
    """Over the parts that no case has."""
    return friction(data)


#: How far halves of what is not diagnosed lie apart; friction is not linear over its speeds.
_OURS: Final = "our regression over the four tens of seconds that are not diagnosed; less what the URDF states"
_C_RANGE: Final = ((1.4, 2.4), (3.2, 6.2), (2.4, 3.2), (2.0, 2.6))
_V_RANGE: Final = ((24.0, 33.0), (9.0, 19.0), (3.5, 6.5), (3.0, 5.5))
_RUBS: Final = tuple(
    cause
    for k, joint in enumerate(RUBBING)
    for cause in (
        Cause(
            ("coulomb_friction",),
            joint,
            round(COULOMB[k] - STATED, 3),
            "N·m",
            _C_RANGE[k][0] - STATED,
            _C_RANGE[k][1] - STATED,
            REGRESSION,
            _OURS,
        ),
        Cause(
            ("viscous_friction",),
            joint,
            round(VISCOUS[k] - STATED, 3),
            "N·m·s/rad",
            _V_RANGE[k][0] - STATED,
            _V_RANGE[k][1] - STATED,
            REGRESSION,
            _OURS,
            ("servo_damping",),
        ),
    )
)
#: Payload and motor constants are not known; the torques are 20 to 40 % above the rigid model's on arm_3 and arm_4.
_UNKNOWN: Final = ("payload", "torque_constant", "encoder_bias", "gravity_tilt", "asymmetric_friction", "armature")
_PARTS: Final = "diagnosed: 0-10, 20-30, 40-50, 60-70 s; regression: 10-20, 30-40, 50-60, 70-80 s"

CASES: Final = (
    Case(
        "tiago-arm-friction",
        "TIAGo arm",
        WHOLE,
        EFFORTS,
        SOURCE.name,
        FILES,
        _logs,
        None,
        "this package's tiago_pal_gripper, whose joints have the friction of the URDF",
        "most of the friction; an unknown payload",
        _RUBS,
        truth_files=FILES,
        may=_UNKNOWN,
        parts=_PARTS,
    ),
    Case(
        "tiago-arm-nothing",
        "TIAGo arm",
        NOTHING,
        EFFORTS,
        SOURCE.name,
        FILES,
        _logs,
        None,
        "the same, with the friction that the regression found",
        "nothing but the unknown payload",
        (),
        truth_files=FILES,
        may=(*_UNKNOWN, "coulomb_friction", "viscous_friction"),
        known=tuple(
            {"name": name, "target": joint, "parameters": {parameter: round(value - STATED, 3)}}
            for k, joint in enumerate(RUBBING)
            for name, parameter, value in (
                ("coulomb_friction", "force", COULOMB[k]),
                ("viscous_friction", "damping", VISCOUS[k]),
            )
        ),
        parts=_PARTS,
        note="payload and motor constants are unknown, so they may be named, and a rest of friction",
    ),
)
