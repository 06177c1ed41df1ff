"""Objects to grasp: what they are, and how a compiled model is given one.

An object is one free body with one geom, upright on the table. Its contact with the pads is compliant
(:mod:`tiago_mj.models.compliance`); its contact with the table is MuJoCo's default.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.io.quoting import did_you_mean, is_number, is_one_of, quoted
from tiago_mj.models import names
from tiago_mj.models.compliance import Compliance

SHAPES: Final[Mapping[str, mujoco.mjtGeom]] = MappingProxyType(
    {"cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER, "box": mujoco.mjtGeom.mjGEOM_BOX}
)


@dataclass(frozen=True)
class GraspObject:
    """An object to grasp: shape, size, mass, friction and stiffness.

    Attributes:
        shape: ``cylinder`` (upright) or ``box``.
        width: extent along the grasp axis [m]: a cylinder's diameter, a box's side.
        height: vertical extent [m].
        mass: [kg].
        stiffness: of the contact with one pad: pad force over approach of pad and object [N/m].
        damping: of the same contact [N·s/m].
        friction: sliding friction coefficient with pad and table.
    """

    shape: str = "cylinder"
    width: float = 0.04
    height: float = 0.1
    mass: float = 0.421
    stiffness: float = 10_000.0
    damping: float = 100.0
    friction: float = 1.0

    def __post_init__(self) -> None:
        if not is_one_of(self.shape, SHAPES):
            raise ValueError(f"object shape {quoted(self.shape)} is unknown: use one of {', '.join(SHAPES)}")
        for field in ("width", "height", "mass", "stiffness", "friction"):
            value = getattr(self, field)
            if not (is_number(value) and value > 0):
                raise ValueError(f"object {field} is {quoted(value)}: give a positive, finite number")
        if not (is_number(self.damping) and self.damping >= 0):
            raise ValueError(f"object damping is {quoted(self.damping)}: give a finite number, 0 or more [N·s/m]")

    @property
    def compliance(self) -> Compliance:
        """Compliance of the contact with one pad."""
        return Compliance(self.stiffness, self.damping)

    def geom_size(self) -> NDArray[np.float64]:
        """MuJoCo's geom size, (3,) [m]."""
        half = self.width / 2
        return np.array([half, self.height / 2, 0.0] if self.shape == "cylinder" else [half, half, self.height / 2])

    def half_extents(self) -> NDArray[np.float64]:
        """Half sizes of the bounding box, (3,) [m]."""
        return np.array([self.width / 2, self.width / 2, self.height / 2])

    def inertia(self) -> NDArray[np.float64]:
        """Principal moments about the centre of the homogeneous solid, (3,) [kg·m²]."""
        w, h = self.width, self.height
        if self.shape == "cylinder":
            across = self.mass * (3 * (w / 2) ** 2 + h**2) / 12
            return np.array([across, across, self.mass * (w / 2) ** 2 / 2])
        across = self.mass * (w**2 + h**2) / 12
        return np.array([across, across, self.mass * w**2 / 6])


#: Ready-made objects. ``cylinder`` is the 2021 project's: r 0.02 m, h 0.1 m, 0.421 kg "real-life parameters"
#: (llach/tiago_rl 1413ef5), contact 10 kN/m and 100 N·s/m (fc08124 to its released cc5ce92; for ten days before it was
#: 30 kN/m and 1000 N·s/m, then 3 kN/m and 100, which is ``cylinder_soft``). ``box`` and ``box_soft`` are the same
#: things with flat sides; ``wood`` and ``sponge`` have the widths of the objects of the real TA11 measurements
#: (llach/learning_fc 3dd34c2); their masses are ours, from the volume at 700 and 60 kg/m³; the sponge's contact is
#: chosen soft, not measured.
OBJECTS: Final[Mapping[str, GraspObject]] = MappingProxyType(
    {
        "cylinder": GraspObject(),
        "cylinder_soft": GraspObject(stiffness=3_000.0, damping=100.0),
        "box": GraspObject(shape="box"),
        "box_soft": GraspObject(shape="box", stiffness=3_000.0, damping=100.0),
        "wood": GraspObject(shape="box", width=0.059, mass=0.244),
        "sponge": GraspObject(shape="box", width=0.042, mass=0.0106, stiffness=1_000.0, damping=10.0),
    }
)


#: What a dictionary may say of an object, as a recording's sidecar does: field, and factor to the field's unit.
KEYS: Final[Mapping[str, tuple[str, float]]] = MappingProxyType(
    {
        "shape": ("shape", 1.0),
        "radius_m": ("width", 2.0),
        "width_m": ("width", 1.0),
        "height_m": ("height", 1.0),
        "mass_kg": ("mass", 1.0),
        "stiffness": ("stiffness", 1.0),
        "damping": ("damping", 1.0),
        "friction": ("friction", 1.0),
    }
)


def described_object(said: Mapping[str, Any]) -> GraspObject:
    """An object from a mapping with the keys of :data:`KEYS`; missing ones are those of the default object.

    Args:
        said: ``shape``; ``radius_m`` or ``width_m``, ``height_m`` [m]; ``mass_kg`` [kg]; ``stiffness`` [N/m] and
            ``damping`` [N·s/m] of the contact with one pad; ``friction``.

    Raises:
        ValueError: no key, an unknown one, both radius and width, or a number that no object can have; one line.
    """
    if not said:
        raise ValueError(f"object says nothing: use {', '.join(KEYS)}")
    changes: dict[str, Any] = {}
    for key, value in said.items():
        if not is_one_of(key, KEYS):
            near = next((one for one in KEYS if key == one.rpartition("_")[0]), None)  # it lacks its unit
            mend = f"did you mean {near!r}?" if near else did_you_mean(key, tuple(KEYS))
            raise ValueError(f"object has no key {quoted(key)}: {mend}")
        field, factor = KEYS[key]
        if field in changes:
            raise ValueError("object has radius_m and width_m: give one of them")
        if field != "shape" and not is_number(value):
            raise ValueError(f"object {key} is {quoted(value)}: give a number")
        changes[field] = value if field == "shape" else factor * value
    return GraspObject(**changes)


def named_object(name: str, **changes: Any) -> GraspObject:
    """The object of that name, with fields replaced.

    Raises:
        ValueError: no such object; says which there are.
    """
    if not is_one_of(name, OBJECTS):
        raise ValueError(
            f"object {quoted(name)} is unknown: use one of {', '.join(OBJECTS)}, or describe your own by a dictionary "
            "with shape, width_m, height_m, mass_kg"
        )
    return replace(OBJECTS[name], **changes)


def give_object(model: mujoco.MjModel, item: GraspObject, scratch: mujoco.MjData | None = None) -> None:
    """Set the model's object to ``item``: shape, size, mass, inertia, friction, and the constants derived from them.

    Args:
        model: with an object in it.
        item: the other object.
        scratch: of the model, to compute in: its state is lost. None: made anew, which takes longer than all the rest.
    """
    body = model.body(names.OBJECT_BODY).id
    geom = model.geom(names.OBJECT_GEOM).id
    size, half = item.geom_size(), item.half_extents()
    model.geom_type[geom] = int(SHAPES[item.shape])
    model.geom_size[geom] = size
    model.geom_rbound[geom] = np.linalg.norm(half) if item.shape == "box" else np.hypot(half[0], half[2])
    model.geom_aabb[geom] = np.concatenate([np.zeros(3), half])
    model.bvh_aabb[model.body_bvhadr[body]] = model.geom_aabb[geom]  # one geom: the body's only bounding volume
    model.geom_friction[geom, 0] = item.friction
    model.body_mass[body] = item.mass
    model.body_inertia[body] = item.inertia()
    mujoco.mj_setConst(model, mujoco.MjData(model) if scratch is None else scratch)
