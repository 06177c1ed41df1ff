"""Meshes: finding the file behind a URDF's address, and reading STL, OBJ and DAE."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import trimesh

from tiago_mj.io import extra
from tiago_mj.models.convert.errors import ConversionError
from tiago_mj.models.convert.urdf import Shape

FORMATS = (".stl", ".obj", ".dae", ".ply", ".glb", ".off")
#: Of a mesh's file.
BYTES, LINES = 64_000_000, 1_000_000
#: Coordinates, in whatever unit.
LARGEST = 1e9
#: Options of ``convert`` with which no mesh is looked for: masses and joints are all that a diagnosis needs.
WITHOUT = "--visual none --collision none"


def resolve(shape: Shape, urdf: Path, package_paths: Sequence[Path] = ()) -> Path:
    """File of a mesh shape: ``package://`` and ``model://`` addresses, ``file://``, absolute or relative to the URDF.

    A package is looked for in ``package_paths``, then in ``ROS_PACKAGE_PATH``, then in the folders above the URDF; a
    folder counts both as a place of packages and as the package itself when it bears its name.

    Raises:
        ConversionError: the file does not exist; the message says how to name the package's folder, or do without.
    """
    address = shape.mesh or ""
    scheme, _, rest = address.rpartition("://")
    rest = unquote(rest) if scheme else address
    if scheme in ("package", "model"):
        package, _, inside = rest.partition("/")
        for folder in _package_folders(urdf, package_paths):
            for candidate in (folder / package / inside, folder / inside if folder.name == package else None):
                if candidate is not None and candidate.is_file():
                    return candidate
        what = f'mesh "{address}" is not found'
        mend = f'name the folder that holds package "{package}" with --package-path, or do without: {WITHOUT}'
        raise ConversionError(shape.where, what, mend)
    if scheme not in ("", "file"):
        raise ConversionError(shape.where, f'mesh "{address}" has the scheme {scheme}://', "use package:// or a path")
    path = urdf.parent / rest  # an absolute path replaces the parent
    if not path.is_file():
        mend = f"put the file there or mend the address, or do without: {WITHOUT}"
        raise ConversionError(shape.where, f'mesh "{address}" is not found at {path}', mend)
    return path


def _package_folders(urdf: Path, package_paths: Sequence[Path]) -> Iterable[Path]:
    yield from (Path(path).resolve() for path in package_paths)
    yield from (Path(entry) for entry in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if entry)
    yield from urdf.resolve().parents


def load(shape: Shape, path: Path) -> Any:
    """The mesh of a shape as one ``trimesh.Trimesh``, scaled as the URDF says [m], in the shape's own frame.

    Raises:
        ConversionError: a format that is not read, a reader that is not installed, a broken or an empty file.
    """
    if path.suffix.lower() not in FORMATS:
        what = f"mesh {path.name} has the format {path.suffix or '(none)'}"
        raise ConversionError(shape.where, what, f"convert it to one of {' '.join(FORMATS)}")
    _check_size(shape, path)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")  # of what it trips over, which is looked at below
            mesh = trimesh.load(path, force="mesh", process=False)
    except ImportError as error:
        mend = f"run {extra.pip()} {'pycollada' if path.suffix.lower() == '.dae' else error.name}"
        raise ConversionError(shape.where, f"mesh {path.name} needs a reader that is not installed", mend) from None
    except Exception as error:  # trimesh's readers raise whatever the file makes them trip over
        reason = f"{type(error).__name__}: {error}"
        raise ConversionError(
            shape.where, f"mesh {path} cannot be read ({reason})", "export it again, best as STL"
        ) from None
    if not _is_whole(mesh):
        raise ConversionError(shape.where, f"mesh {path} holds no triangles", "export it again, best as STL")
    scale = np.array(shape.size) * _metres_per_unit(mesh, path)
    if np.abs(scale).max() > LARGEST:
        what = f"mesh {path} is scaled by {np.abs(scale).max():g}"
        raise ConversionError(shape.where, what, "give a scale such as 0.001")
    if not np.allclose(scale, 1.0):
        mesh.apply_transform(np.diag([*scale, 1.0]))
    return mesh


def _check_size(shape: Shape, path: Path) -> None:
    """Refuse what takes more memory than a mesh that MuJoCo reads (200 000 triangles).

    Raises:
        ConversionError: the file is too large, or has too many lines.
    """
    size, lines = 0, 0
    with path.open("rb") as file:
        while block := file.read(1 << 22):
            size += len(block)
            lines += block.count(b"\n")
            if size > BYTES or (path.suffix.lower() in (".obj", ".off", ".dae") and lines > LINES):
                what = f"mesh {path.name} has more than {BYTES // 1_000_000} MB or {LINES} lines"
                raise ConversionError(shape.where, what, "MuJoCo reads 200000 triangles: simplify it")


def _is_whole(mesh: Any) -> bool:
    """Whether it has triangles, all of them between points that it has."""
    faces, points = np.asarray(getattr(mesh, "faces", ())), np.asarray(getattr(mesh, "vertices", ()))
    if faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0 or points.ndim != 2 or points.shape[1] != 3:
        return False
    inside = faces.min() >= 0 and faces.max() < len(points)
    return bool(inside and np.isfinite(points).all() and np.abs(points).max() < LARGEST)


def _metres_per_unit(mesh: Any, path: Path) -> float:
    """DAE says its unit, and ROS heeds it; other formats are in metres. DAE's up axis ROS ignores, and so do we."""
    unit = getattr(mesh, "units", None)
    if path.suffix.lower() != ".dae" or unit is None:
        return 1.0
    return float(trimesh.units.unit_conversion(unit, "meters"))


def color(mesh: Any) -> tuple[float, ...] | None:
    """The colour that covers most of a mesh (rgba, 0..1); None where the file gives none."""
    visual: Any = getattr(mesh, "visual", None)
    kind = getattr(visual, "kind", None)
    if kind == "texture":
        material = getattr(visual, "material", None)
        main = getattr(material, "main_color", None)
        return None if main is None else tuple(float(c) / 255 for c in main)
    if kind not in ("face", "vertex"):
        return None
    colors, index = np.unique(np.asarray(visual.face_colors), axis=0, return_inverse=True)
    area = np.bincount(index.ravel(), weights=mesh.area_faces)
    return tuple(float(c) / 255 for c in colors[int(area.argmax())])
