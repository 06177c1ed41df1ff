"""Names of a robot's joints, actuators and sensors, and the interfaces of its commands, to check recordings against."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final

from tiago_mj.io.loading import is_file
from tiago_mj.recordings.recording import RecordingError

#: Endings of what is simulated as a file, and not as one of the environments.
MODELS: Final = (".xml", ".urdf", ".xacro")
#: How alike a mistyped name is to what is meant, as :mod:`difflib` measures it.
ALIKE: Final = 0.7


@dataclass(frozen=True)
class Robot:
    """Names and interfaces of a compiled model.

    Attributes:
        joints: every named joint.
        slides: those that slide.
        driven: joint by actuator; only actuators that drive one joint.
        interfaces: by actuator, what it can be commanded by, its own interface first; empty where the model does not
            tell (:func:`tiago_mj.models.actuators.replayed_interfaces`).
    """

    joints: tuple[str, ...]
    slides: frozenset[str]
    driven: Mapping[str, str]
    interfaces: Mapping[str, tuple[str, ...]]

    @classmethod
    def of_model(cls, model: Any) -> Robot:
        """Names of a compiled ``mujoco.MjModel``; unnamed elements are left out."""
        # Recordings are read without a simulator: MuJoCo is loaded for a model alone.
        import mujoco

        from tiago_mj.models.actuators import driven_joint, replayed_interfaces

        joints = [(model.joint(j).name, int(model.jnt_type[j])) for j in range(model.njnt)]
        actuators = [(model.actuator(a).name, a) for a in range(model.nu)]
        driven = {name: driven_joint(model, a) for name, a in actuators if name}
        return cls(
            joints=tuple(name for name, _ in joints if name),
            slides=frozenset(name for name, kind in joints if kind == int(mujoco.mjtJoint.mjJNT_SLIDE)),
            driven={name: joint for name, joint in driven.items() if joint},
            interfaces={name: replayed_interfaces(model, a) for name, a in actuators if name},
        )

    @property
    def actuators(self) -> tuple[str, ...]:
        """Every named actuator."""
        return tuple(self.interfaces)

    def drives(self, joint: str) -> tuple[str, ...]:
        """Actuators of a joint."""
        return tuple(name for name, driven in self.driven.items() if driven == joint)


def robot_of(file: str) -> Robot | None:
    """The robot of a model file; None where the name is not a file, such as an environment.

    Raises:
        RecordingError: the file is no model that can be compiled; one line.
    """
    path = Path(file)
    if not file.endswith(MODELS) or not is_file(path):
        return None
    # As in of_model: only a model needs MuJoCo.
    from tiago_mj.models.bounded import load_model

    return Robot.of_model(load_model(path, f"{path.name} does not compile", RecordingError))


def nearest(name: str, known: Any) -> str | None:
    """The known name most similar to a given one; None where none is similar."""
    return next(iter(get_close_matches(name, list(known), 1, ALIKE)), None)
