"""The effects of a diagnosis and the user's model that they belong to, read from a DIAGNOSIS folder."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import mujoco
import yaml

from tiago_mj.effects import Entry, check_entries, model_file, read_effects, written
from tiago_mj.effects.now import Wiring
from tiago_mj.effects.wiring import wire
from tiago_mj.io.quoting import quoted
from tiago_mj.models.bounded import load_model
from tiago_mj.recordings.record.plain import interface_of, scalar_joints

#: The file of a diagnosis that names what was found.
CALIBRATION: Final = "calibration.yaml"


@dataclass(frozen=True)
class Found:
    """What a diagnosis found.

    Attributes:
        path: of the ``calibration.yaml``.
        robot: name of the model file or environment that was diagnosed.
        entries: the effects.
        rate_hz: of commands [Hz]; None: not said, as of an environment.
        interface: what commands are; None as above.
        timestep: physics step of the diagnosis [s]; None as above.
        joints, actuators: names; empty as above.
    """

    path: Path
    robot: str
    entries: tuple[Entry, ...]
    rate_hz: float | None
    interface: str | None
    timestep: float | None
    joints: tuple[str, ...]
    actuators: tuple[str, ...]


@dataclass(frozen=True)
class Robot:
    """A user's model and what was found of it, resolved: names, times and the parts that effects act on.

    Attributes:
        file: the MJCF.
        model: compiled, nominal, with the file's own physics step.
        wiring: parts of the model.
        entries: effects, all known to fit the model.
        period: of control [s].
        timestep: physics step of the diagnosis [s].
    """

    file: Path
    model: mujoco.MjModel
    wiring: Wiring
    entries: tuple[Entry, ...]
    period: float
    timestep: float

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the observed joints."""
        return self.wiring.targets.joint

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of the commanded actuators."""
        return self.wiring.targets.command

    @property
    def substeps(self) -> int:
        """Physics steps of the file in a control period, one at least."""
        return max(round(self.period / self.model.opt.timestep), 1)


def read(path: Path, *, numbers: bool = True) -> Found:
    """The effects of a DIAGNOSIS folder, or of its ``calibration.yaml`` itself.

    Args:
        path: of either.
        numbers: whether the nominal model's numbers as fitted are among them.

    Raises:
        ValueError: there is no such folder or file, or it is no calibration; one line.
    """
    file = calibration_file(path)
    said = written.load(file)
    if not isinstance(said, dict) or "schema" not in said:
        raise ValueError(f"{file} is no calibration: give the folder that tiago-mj diagnose --out wrote")
    said = written.calibration(said)
    return Found(
        path=file,
        robot=said.get("robot") or "",
        entries=read_effects(file, numbers=numbers),
        rate_hz=said.get("rate_hz"),
        interface=said.get("interface"),
        timestep=said.get("timestep"),
        joints=tuple(said.get("joints") or ()),
        actuators=tuple(said.get("actuators") or ()),
    )


def calibration_file(path: Path) -> Path:
    """The ``calibration.yaml`` of a DIAGNOSIS folder, or the file itself.

    Raises:
        ValueError: there is none; one line.
    """
    if not path.exists():
        raise ValueError(f"no diagnosis at {path}: give the folder that tiago-mj diagnose --out wrote")
    file = path / CALIBRATION if path.is_dir() else path
    if not file.is_file():
        raise ValueError(f"{path} holds no {CALIBRATION}: give the folder that tiago-mj diagnose --out wrote")
    return file


def copy(found: Found, path: Path, *, numbers: bool = True) -> None:
    """Copy the calibration, byte by byte, or without the nominal model's numbers as fitted."""
    if numbers:
        shutil.copyfile(found.path, path)
        return
    said = written.without_numbers(written.load(found.path))
    path.write_text(yaml.safe_dump(said, sort_keys=False, allow_unicode=True, width=120), encoding="utf-8")


def model_path(found: Found, given: Path | None) -> Path:
    """The user's model file: as given, else the file of the diagnosed robot's name beside the diagnosis or here.

    Raises:
        ValueError: it is not there; one line.
    """
    if given is not None:
        if not given.is_file():
            raise ValueError(f"model {given}: no such file")
        return given
    if found.robot.endswith(".xml"):
        folder = found.path.resolve().parent
        for place in (folder, folder.parent, Path.cwd()):
            if (place / Path(found.robot).name).is_file():
                return place / Path(found.robot).name
        raise ValueError(f"the diagnosis is of {found.robot}, which is not beside it: give --model PATH/{found.robot}")
    raise ValueError(
        f"the diagnosis is of {quoted(found.robot)}, an environment of this package: use --to gymnasium, or give "
        "--model FILE.xml"
    )


def resolve(found: Found, file: Path, rate_hz: float | None = None) -> Robot:
    """The user's model with the parts that the effects act on.

    Args:
        found: of :func:`read`.
        file: of :func:`model_path`.
        rate_hz: of commands [Hz], where the calibration does not say.

    Raises:
        ValueError: the model does not compile, is a repaired one already, or does not have what the effects name; one
            line.
    """
    model = load_model(file, f"model {file.name}")
    if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, model_file.MARK) >= 0:
        raise ValueError(f"model {file.name} has the effects already: give the one that was diagnosed")
    rate = found.rate_hz or rate_hz
    if rate is None:
        raise ValueError("nothing says how often the robot is commanded: give --rate HZ")
    wiring = wire(
        model,
        joints=found.joints or scalar_joints(model),
        actuators=found.actuators or _names(model),
        interface=found.interface or interface_of(model),
    )
    check_entries(found.entries, model, wiring)
    return Robot(file, model, wiring, found.entries, 1 / rate, found.timestep or model.opt.timestep)


def _names(model: mujoco.MjModel) -> Sequence[str]:
    return [model.actuator(k).name for k in range(model.nu)]
