"""Where the model files lie: inside the installed package, or in the checkout of an editable installation."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2] / "models"


def models_folder() -> Path:
    """Folder that holds ``robots/``, ``sources/`` and ``PROVENANCE.md``.

    Raises:
        FileNotFoundError: neither the package nor a checkout carries it.
    """
    installed = Path(str(resources.files("tiago_mj.models"))) / "data"
    for folder in (installed, CHECKOUT):
        if (folder / "robots").is_dir():
            return folder
    raise FileNotFoundError(f"no model files under {installed} or {CHECKOUT}: reinstall tiago-mj")


def model_file(name: str) -> Path:
    """Path of a model file, such as ``robots/gripper_ta11.xml``.

    Raises:
        FileNotFoundError: no such file; the message lists what the folder holds.
    """
    folder = models_folder()
    path = folder / name
    if not path.is_file():
        there = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.suffix in {".xml", ".urdf"})
        raise FileNotFoundError(f"no model file {name!r}; there are {', '.join(there)}")
    return path
