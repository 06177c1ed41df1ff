"""Effects written into a user's MJCF by changing as few attributes of its text as there are numbers that differ."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import model_file
from tiago_mj.effects.command import LINEAR
from tiago_mj.effects.tendons import Tendon
from tiago_mj.export import play
from tiago_mj.export.actuators import actuator_changes
from tiago_mj.export.found import Robot
from tiago_mj.export.mjcf_text import Element, Mjcf
from tiago_mj.export.numbers import numbers
from tiago_mj.export.versions import NEWEST

Array = NDArray[np.float64]

#: Attributes of MJCF by the compiled model's field.
OF_JOINTS: Final = {
    "dof_frictionloss": "frictionloss",
    "dof_solref": "solreffriction",
    "dof_solimp": "solimpfriction",
    "dof_damping": "damping",
    "dof_armature": "armature",
}
OF_BODIES: Final = {"body_mass": "mass", "body_ipos": "pos", "body_iquat": "quat", "body_inertia": "diaginertia"}
#: Other ways to say an inertial frame, which go when it is said anew.
_TURNED: Final = ("quat", "axisangle", "euler", "xyaxes", "zaxis", "fullinertia")
#: Versions that compute a servo's damping from ``dampratio`` by another inertia (until 3.15; its changelog).
OTHER_RATIOS: Final = ("3.11",)
#: The form in which files have what acts on two joints.
IN_TENDONS: Final = "a fixed tendon over both joints"
#: Share of a number that a compiled file may differ by from what was simulated.
ALIKE: Final = 1e-9


@dataclass(frozen=True)
class Written:
    """A model as text.

    Attributes:
        files: bytes of every file that was changed, by its path in the user's folder.
        main: the main file, as there.
        beside: files that the model needs and that stay as they are.
        exact: names of effects that the files hold as they were simulated.
        approximate: names of effects that they hold in another form, and in which.
        lacking: names of effects that they do not hold because of what the user's files have, and why.
        told: what a user of the files has to know, in sentences.
    """

    files: Mapping[Path, bytes]
    main: Path
    beside: tuple[Path, ...]
    exact: tuple[str, ...]
    approximate: Mapping[str, str]
    lacking: Mapping[str, str]
    told: tuple[str, ...]

    @property
    def root(self) -> Path:
        """Folder that holds all of the model's files."""
        folders = [str(path.parent) for path in (self.main, *self.files, *self.beside)]
        return Path(os.path.commonpath(folders))

    def save(self, folder: Path) -> Path:
        """Write the model into a folder, laid out as in the user's; the main file's path there."""
        for path in (*self.files, *self.beside):
            there = folder / path.relative_to(self.root)
            there.parent.mkdir(parents=True, exist_ok=True)
            there.write_bytes(self.files[path] if path in self.files else path.read_bytes())
        return folder / self.main.relative_to(self.root)

    def compile(self) -> mujoco.MjModel:
        """The compiled model.

        Raises:
            ValueError: MuJoCo does not compile it.
        """
        with tempfile.TemporaryDirectory() as folder:
            return mujoco.MjModel.from_xml_path(str(self.save(Path(folder))))


def write(robot: Robot, *, version: str = NEWEST, without: Collection[str] = ()) -> Written:
    """The user's files with the effects that MJCF can hold.

    Args:
        robot: the model and the effects.
        version: of MuJoCo that is to load them.
        without: names of effects that are left out, as the reader of the files has them elsewhere or not at all.

    Raises:
        ValueError: what is to be changed is not written out in the files (built by ``attach``, say), or the result is
            not the model that was simulated; one line.
    """
    period = robot.substeps * float(robot.model.opt.timestep)
    by_name = {name: own for name, own in model_file.by_effect(robot.entries).items() if name not in without}
    exact = [
        name
        for name, entries in by_name.items()
        if model_file.holds(robot.model, robot.wiring, entries, period, robot.substeps)
    ]
    chain = model_file.changed(
        robot.model, robot.wiring, [entry for name in exact for entry in by_name[name]], period, robot.substeps
    )
    wanted = chain.now.host.model
    native = model_file.actuator_attributes(chain, robot.wiring)
    rest = {name: own for name, own in by_name.items() if name not in exact}
    tendons = {effect.name: model_file.tendons_of([effect], chain.now) for effect in chain.effects}
    in_tendons = {name: IN_TENDONS for name, own in tendons.items() if own}
    written = replace(
        _with_numbers(robot, wanted, native, [one for own in tendons.values() for one in own], version),
        exact=tuple(name for name in exact if name not in in_tendons),
        approximate=in_tendons,
    )
    plays = play.plays(robot, rest)
    if not plays:
        return written
    try:
        return _with_play(robot, written, plays, wanted)
    except ValueError as fault:  # the rest is of use without it
        return replace(written, lacking={one.effect: str(fault) for one in plays})


def _with_numbers(
    robot: Robot,
    wanted: mujoco.MjModel,
    native: Mapping[int, Mapping[str, float]],
    tendons: Sequence[Tendon],
    version: str,
) -> Written:
    """With the numbers of a compiled model, attributes of its actuators, and tendons that it has not."""
    mjcf = Mjcf(robot.file)
    for actuator, attributes in native.items():
        mjcf.set(_actuator(mjcf, robot.model, actuator), _in_words(attributes))
    said = _say_damping(mjcf, wanted) if version in OTHER_RATIOS else []
    written, present = _now(mjcf), robot.model
    for _ in range(model_file.PASSES):
        if not _changed(mjcf, present, wanted):
            break
        written = _now(mjcf)
        present = written.compile()
    _check(present, wanted, robot.file.name)
    if tendons:
        mjcf.append(_in_mjcf(tendons))
        written = _now(mjcf)
    late = any("delay" in attributes for attributes in native.values())
    return replace(written, told=(*said, *([model_file.LATE] if late else [])))


def _in_mjcf(tendons: Sequence[Tendon]) -> str:
    """Tendons as MJCF has them."""
    lines = []
    for one in tendons:
        told = {name.replace("_", ""): numbers(*values) for name, values in one.numbers}
        words = "".join(f' {key}="{value}"' for key, value in {"name": one.name, **told}.items())
        joints = "".join(f'<joint joint="{joint}" coef="{numbers(turns)}"/>' for joint, turns in one.turns)
        lines.append(f"    <fixed{words}>{joints}</fixed>")
    return "\n".join(["  <tendon>", *lines, "  </tendon>"])


def _say_damping(mjcf: Mjcf, wanted: mujoco.MjModel) -> list[str]:
    """Write out the damping of servos that is given by its ratio, which older versions compute in another way; what
    the user has to know."""
    said = []
    for actuator in range(wanted.nu):
        element = mjcf.actuator(wanted.actuator(actuator).name)
        if element is not None and "dampratio" in element.attributes:
            mjcf.set(element, {"kv": numbers(-wanted.actuator_biasprm[actuator, 2]), "dampratio": None})
            said.append(f"kv of {wanted.actuator(actuator).name} stands for its dampratio, which gave another there.")
    if any("dampratio" in e.attributes and e.parent is not None and e.parent.name == "default" for e in mjcf.elements):
        said.append("dampratio in a default class gives other damping there: write kv into the actuators.")
    return said


def _with_play(robot: Robot, written: Written, plays: Sequence[play.Play], wanted: mujoco.MjModel) -> Written:
    """With second joints for play and elasticity, on top of files that hold the rest."""
    approximate = {**written.approximate, **{one.effect: one.how for one in plays}}
    told = (*written.told, *(one.told for one in plays))
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder).resolve()
        mjcf = Mjcf(written.save(place))
        for one in plays:
            play.split(mjcf, wanted, one)
        play.lengthen_keys(mjcf, wanted, plays)
        out = _from(mjcf, place, written, approximate, told)
        model = out.compile()
        if _change_actuators(mjcf, model, wanted):  # a damping by ratio was one of the motor's inertia
            out = _from(mjcf, place, written, approximate, told)
            model = out.compile()
    play.check(model, wanted, plays, robot.file.name)
    return out


def _from(mjcf: Mjcf, place: Path, written: Written, approximate: Mapping[str, str], told: tuple[str, ...]) -> Written:
    """What was edited in a copy, by its path in the user's folder."""
    files = {written.root / d.path.relative_to(place): d.edited() for d in mjcf.documents}
    changed = {path: data for path, data in files.items() if data != path.read_bytes()}
    beside = dict.fromkeys(path for path in (*files, *written.beside) if path not in changed)
    return Written(changed, written.main, tuple(beside), written.exact, approximate, {}, told)


def _now(mjcf: Mjcf) -> Written:
    files = {document.path: document.edited() for document in mjcf.documents}
    changed = {path: data for path, data in files.items() if data != path.read_bytes()}
    beside = (*(path for path in files if path not in changed), *mjcf.files())
    return Written(changed, mjcf.path, beside, (), {}, {}, ())


def _in_words(attributes: Mapping[str, float]) -> dict[str, str]:
    """Attributes of an actuator's delay as MJCF has them."""
    return {
        name: ("linear" if value == LINEAR else "zoh") if name == "interp" else numbers(value)
        for name, value in attributes.items()
    }


def _changed(mjcf: Mjcf, model: mujoco.MjModel, wanted: mujoco.MjModel) -> bool:
    """Change the attributes whose numbers differ between two compiled models; whether any did."""
    differ = False
    for joint, changes in _of_joints(model, wanted, degrees=mjcf.in_degrees).items():
        element = mjcf.joint(model.joint(joint).name)
        if element is None:
            raise _unwritten(f"joint {model.joint(joint).name!r}")
        mjcf.set(element, {key: _after_first(element, key, value) for key, value in changes.items()})
        differ = True
    for body in _rows(model, wanted, (*OF_BODIES, "body_gravcomp")):
        _change_body(mjcf, model, wanted, body)
        differ = True
    differ |= _change_actuators(mjcf, model, wanted)
    if not np.array_equal(model.opt.gravity, wanted.opt.gravity):
        option, gravity = mjcf.first("option"), numbers(*wanted.opt.gravity)
        if option is None:
            mjcf.insert_first(mjcf.documents[0].elements[0], f'<option gravity="{gravity}"/>')
        else:
            mjcf.set(option, {"gravity": gravity})
        differ = True
    return differ


def _change_actuators(mjcf: Mjcf, model: mujoco.MjModel, wanted: mujoco.MjModel) -> bool:
    rows = _rows(model, wanted, model_file.OF_ACTUATORS)
    for actuator in rows:
        element = _actuator(mjcf, model, actuator)
        name, attributes = actuator_changes(element, model, wanted, actuator)
        mjcf.set(element, attributes, name)
    return bool(rows)


def _of_joints(model: mujoco.MjModel, wanted: mujoco.MjModel, *, degrees: bool) -> dict[int, dict[str, str]]:
    out: dict[int, dict[str, str]] = {}
    for field, attribute in OF_JOINTS.items():
        for dof in model_file.differing_rows(model, wanted, field):
            out.setdefault(int(model.dof_jntid[dof]), {})[attribute] = numbers(
                *np.atleast_1d(getattr(wanted, field)[dof])
            )
    for joint in model_file.differing_rows(model, wanted, "jnt_actfrcrange"):
        out.setdefault(joint, {})["actuatorfrcrange"] = numbers(*wanted.jnt_actfrcrange[joint])
    for joint, (rest, (linear, *more)) in model_file.differing_springs(model, wanted).items():
        turns = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE
        out.setdefault(joint, {}).update(
            stiffness=numbers(linear, *(more if any(more) else ())),
            springref=numbers(np.degrees(rest) if turns and degrees else rest),
        )
    return out


def _after_first(element: Element, attribute: str, value: str) -> str:
    """A damping that has a polynomial's further coefficients keeps them."""
    further = element.attributes.get(attribute, "").split()[1:]
    return " ".join([value, *further]) if attribute == "damping" else value


def _change_body(mjcf: Mjcf, model: mujoco.MjModel, wanted: mujoco.MjModel, body: int) -> None:
    name = model.body(body).name
    element = mjcf.body(name) if name else _body_of_a_joint(mjcf, model, body)
    if element is None:
        raise _unwritten(f"body {name!r}")
    if wanted.body_gravcomp[body] != model.body_gravcomp[body]:
        mjcf.set(element, {"gravcomp": numbers(wanted.body_gravcomp[body])})
    differing = [field for field in OF_BODIES if body in model_file.differing_rows(model, wanted, field)]
    if not differing:
        return
    inertial = next((child for child in mjcf.children(element) if child.name == "inertial"), None)
    said = {attribute: numbers(*np.atleast_1d(getattr(wanted, field)[body])) for field, attribute in OF_BODIES.items()}
    if inertial is None:
        attributes = " ".join(f'{key}="{said[key]}"' for key in ("pos", "quat", "mass", "diaginertia"))
        mjcf.insert_first(element, f"<inertial {attributes}/>")
    elif differing == ["body_mass"]:
        mjcf.set(inertial, {"mass": said["mass"]})
    else:
        mjcf.set(inertial, {**dict.fromkeys(_TURNED), **said})


def _body_of_a_joint(mjcf: Mjcf, model: mujoco.MjModel, body: int) -> Element | None:
    """A body without a name, found by its first joint."""
    joint = int(model.body_jntadr[body])
    element = mjcf.joint(model.joint(joint).name) if joint >= 0 else None
    return None if element is None else next((e for e in element.ancestors() if e.name == "body"), None)


def _actuator(mjcf: Mjcf, model: mujoco.MjModel, actuator: int) -> Element:
    element = mjcf.actuator(model.actuator(actuator).name)
    if element is None:
        raise _unwritten(f"actuator {model.actuator(actuator).name!r}")
    return element


def _rows(model: mujoco.MjModel, wanted: mujoco.MjModel, fields: Iterable[str]) -> list[int]:
    return sorted({row for field in fields for row in model_file.differing_rows(model, wanted, field)})


def _unwritten(what: str) -> ValueError:
    return ValueError(f"{what} is not written out in the model's files (built by attach or replicate?): write it out")


def _check(model: mujoco.MjModel, wanted: mujoco.MjModel, name: str) -> None:
    for field in sorted(model_file.HELD - {model_file.GRAVITY}):
        one, other = getattr(model, field), getattr(wanted, field)
        if one.shape != other.shape or not np.allclose(one, other, rtol=ALIKE, atol=1e-12):
            raise ValueError(
                f"{name} does not take the effects as text (its {field} would differ, as <compiler> settings change "
                "masses, say): use the repaired.xml of the diagnosis"
            )
