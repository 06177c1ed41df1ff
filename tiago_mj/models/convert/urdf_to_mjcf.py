"""Conversion of a URDF file to an MJCF file: the sequence of steps."""

from __future__ import annotations

import os
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.io import held
from tiago_mj.models.convert import additions, surroundings, tree, urdf
from tiago_mj.models.convert import extras as extras_file
from tiago_mj.models.convert.assembly import Assembly, Options
from tiago_mj.models.convert.errors import ConversionError
from tiago_mj.models.convert.report import ConversionReport


def convert(
    urdf_path: Path | str,
    out: Path | str | None = None,
    *,
    extras: Path | str | None = None,
    options: Options | None = None,
) -> ConversionReport:
    """Convert a URDF to MJCF.

    Args:
        urdf_path: the URDF file.
        out: the MJCF file to write; meshes that it needs go to the folder ``<stem>_meshes`` beside it. None: write
            nothing.
        extras: the additions file (YAML); None takes the one beside the URDF (same name, ``.yaml``) if there is one.
        options: shapes, base, masses and scene; None: those of :class:`Options`.

    Returns:
        What was repaired, fitted, excluded, added and dropped, with the model as an MjSpec and as XML text.

    Raises:
        ConversionError: (a ValueError) one line that names file, element and mend. Nothing is written then.
    """
    chosen = options or Options()
    path, target = Path(urdf_path), None if out is None else Path(out)
    robot = urdf.read(path)
    additions_path = Path(extras) if extras is not None else extras_file.beside(path)
    more = extras_file.Extras() if additions_path is None else extras_file.read(additions_path)
    assembly = Assembly(robot, tree.build(robot), more, chosen, mesh_folder=f"{(target or path).stem}_meshes")
    assembly.build()
    try:
        additions.apply(assembly)
        pose = _rest(assembly.spec.compile())
        excluded = _exclude_touching(assembly.spec, pose)
        if chosen.scene:
            assembly.added.append(surroundings.add(assembly.spec, pose, solid=chosen.base == "free"))
        assembly.spec.compile()
    except (mujoco.FatalError, ValueError) as error:
        if isinstance(error, ConversionError):
            raise
        raise ConversionError(
            str(path), f"MuJoCo refuses the model ({error})", "mend the element that it names"
        ) from None
    xml = _text(assembly.spec)
    if target is not None:
        _write(target, xml, dict(assembly.spec.assets))
    return ConversionReport(
        robot=robot.name,
        out=target,
        repaired=tuple(assembly.repaired),
        fitted=tuple(assembly.fitted),
        excluded=excluded,
        dropped=tuple(f"{count} x <{tag}>" for tag, count in robot.ignored.items()),
        added=tuple(assembly.added),
        xml=xml,
        spec=assembly.spec,
    )


def _rest(model: mujoco.MjModel) -> NDArray[np.float64]:
    """Pose of the robot at rest, (nq,): zero, clipped to each joint's range."""
    pose: NDArray[np.float64] = model.qpos0.copy()
    for i in range(model.njnt):
        if model.jnt_limited[i]:
            address = model.jnt_qposadr[i]
            pose[address] = np.clip(pose[address], *model.jnt_range[i])
    return pose


def _exclude_touching(spec: mujoco.MjSpec, pose: NDArray[np.float64]) -> tuple[tuple[str, str], ...]:
    """Exclude contacts between links whose shapes overlap at rest, and return their names; a real robot does not
    collide there."""
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = pose
    mujoco.mj_forward(model, data)
    pairs: dict[tuple[str, str], None] = {}
    for geoms in data.contact.geom:
        first, second = (model.body(model.geom_bodyid[geom]).name for geom in geoms)
        if first != "world" and second != "world":
            pairs[(first, second)] = None
    for first, second in pairs:
        spec.add_exclude(bodyname1=first, bodyname2=second)
    return tuple(pairs)


def _text(spec: mujoco.MjSpec) -> str:
    """The MJCF text, with ``autolimits`` written out although it is the default."""
    return spec.to_xml().replace('<compiler angle="radian"', '<compiler angle="radian" autolimits="true"', 1)


def _write(out: Path, xml: str, assets: dict[str, bytes]) -> None:
    """Write the file and its meshes, each under a temporary name first, so that nothing is ever half written."""
    if not out.parent.is_dir():
        raise ConversionError(str(out), "its folder does not exist", "make it first")
    try:
        with held.temporary_folder(out.parent, "convert") as work:
            for name, content in assets.items():
                file = work / name
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(content)
            (work / out.name).write_text(xml, encoding="utf-8")
            for name in sorted({Path(asset).parts[0] for asset in assets}):
                if (out.parent / name).is_dir():
                    os.replace(out.parent / name, work / f"{name}.old")
                os.replace(work / name, out.parent / name)
            os.replace(work / out.name, out)
    except OSError as error:
        raise ConversionError(str(out), f"cannot be written ({error.strerror})", "choose another place") from None
