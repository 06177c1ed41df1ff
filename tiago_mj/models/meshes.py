"""The robots with real meshes, where ``example-robot-data`` is installed (the extra ``meshes``).

The meshes are PAL Robotics' public ones of an older TIAGo: base, torso, head and the shells of arm_1 to arm_4 fit the
robots here (median distance of 0.4 to 6 mm from their collision primitives, no more than the primitives' own error).
The wrist does not: it has other shells, and arm_5 another frame. Wrist, gripper and fingers therefore keep their
primitives; no public package carries the TA11 fingers. Only looks change: collision, mass and names stay.
"""

from __future__ import annotations

from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

import mujoco

from tiago_mj.io import extra
from tiago_mj.models.convert import meshes, shapes, urdf
from tiago_mj.models.files import model_file

#: Links whose public meshes fit.
FITTING = (
    *("base_link", "torso_fixed_link", "torso_lift_link", "head_1_link", "head_2_link"),
    *("arm_1_link", "arm_2_link", "arm_3_link", "arm_4_link"),
)

#: Links that the robots here have not, as they stand still: their meshes are drawn on the base.
WHEELS = ("wheel_right", "wheel_left")

_ROBOTS = "cmeel.prefix/share/example-robot-data/robots"


def example_robot_data(urdf_name: str = "tiago_description/robots/tiago_no_hand.urdf") -> Path:
    """Path of a URDF in the installed package ``example-robot-data``.

    Raises:
        FileNotFoundError: the package is not installed, or has no such file.
    """
    try:
        distribution = metadata.distribution("example-robot-data")
    except metadata.PackageNotFoundError:
        raise FileNotFoundError(f"example-robot-data is not installed: {extra.install('meshes')}") from None
    path = Path(str(distribution.locate_file(f"{_ROBOTS}/{urdf_name}")))
    if not path.is_file():
        raise FileNotFoundError(f"example-robot-data {distribution.version} has no {urdf_name}: install version 6")
    return path


def with_meshes(robot: str) -> mujoco.MjSpec:
    """A robot whose visual primitives are replaced by meshes on the links of :data:`FITTING`.

    Args:
        robot: ``gripper_ta11`` (nothing to replace), ``tiago_ta11`` or ``tiago_pal_gripper``.

    Raises:
        FileNotFoundError: no such robot, or ``example-robot-data`` is not installed.
    """
    spec = mujoco.MjSpec.from_file(str(model_file(f"robots/{robot}.xml")))
    public = urdf.read(example_robot_data())
    assets: dict[str, bytes] = {}
    for name in FITTING:
        body = spec.body(name)
        if body is None:
            continue
        for geom in [geom for geom in body.geoms if geom.classname.name == "visual"]:
            spec.delete(geom)
        for shape in public.links[name].visuals:
            _add(spec, body, shape, public.path, assets)
    for name in WHEELS:
        joint = public.joints[f"{name}_joint"]
        for shape in public.links[f"{name}_link"].visuals if spec.body(joint.parent) is not None else ():
            _add(spec, spec.body(joint.parent), replace(shape, pose=joint.pose), public.path, assets)
    spec.assets = assets
    return spec


def _add(spec: mujoco.MjSpec, body: Any, shape: urdf.Shape, urdf_path: Path, assets: dict[str, bytes]) -> None:
    path = meshes.resolve(shape, urdf_path)
    file, mesh = f"{path.stem}.stl", meshes.load(shape, path)
    if file not in assets:
        assets[file] = mesh.export(file_type="stl")
        spec.add_mesh(name=path.stem, file=file, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    body.add_geom(
        spec.find_default("visual"),
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=path.stem,
        pos=shape.pose.xyz,
        quat=shapes.quaternion(shapes.rotation(shape.pose)),
        rgba=shape.rgba or meshes.color(mesh) or (0.9, 0.9, 0.9, 1.0),
    )
