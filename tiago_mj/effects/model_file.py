"""An MJCF of a user's own model with effects in it: what the diagnosis simulates, as a file that any MuJoCo loads.

No effect is written twice: each changes a compiled model by its own hook, and what then differs is copied back into the
user's elements. What an effect does between physics steps no file can hold, unless MuJoCo's actuators do the same
(:meth:`tiago_mj.effects.Effect.model_attributes`).
"""

from __future__ import annotations

import copy
import ctypes
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS, Effect
from tiago_mj.effects.chain import EACH_STEP, EACH_SUBSTEP, Chain, acts
from tiago_mj.effects.declare import overrides
from tiago_mj.effects.host import ScalarHost
from tiago_mj.effects.now import Now, Wiring
from tiago_mj.effects.runner import Runner
from tiago_mj.effects.spec import Entry
from tiago_mj.effects.tendons import Tendon, add

Array = NDArray[np.float64]

#: A text element with which a repaired model says that it is one, so that its effects are not applied once more.
MARK: Final = "tiago_mj_repaired"
#: Digits of a written number: with 17 each would be what it was, and 0.1 be 0.10000000000000001.
DIGITS: Final = 16
#: A file's numbers are the model's but for this share (of older MuJoCo libraries, which write six digits).
ALIKE: Final = 1e-5
#: Of actuators with a delay.
LATE: Final = "After a reset, what is on its way to an actuator with a delay is 0: mj_initCtrlHistory fills it."
#: Passes until nothing differs: an inertia that is written may change what the compiler computes of it, a servo's
#: damping by its ratio, say.
PASSES: Final = 3

#: Fields of the compiled model, and the attribute of a joint's, body's or actuator's element that holds them.
OF_JOINTS: Final = {
    "dof_frictionloss": "frictionloss",
    "dof_solref": "solref_friction",
    "dof_solimp": "solimp_friction",
    "dof_damping": "damping",
    "dof_armature": "armature",
}
#: Of joints, not of their degrees of freedom.
OF_WHOLE_JOINTS: Final = {"jnt_actfrcrange": "actfrcrange"}
OF_BODIES: Final = {
    "body_mass": "mass",
    "body_inertia": "inertia",
    "body_ipos": "ipos",
    "body_iquat": "iquat",
    "body_gravcomp": "gravcomp",
}
OF_ACTUATORS: Final = {
    "actuator_gainprm": "gainprm",
    "actuator_biasprm": "biasprm",
    "actuator_forcerange": "forcerange",
    "actuator_forcelimited": "forcelimited",
    "actuator_ctrlrange": "ctrlrange",
}
#: Of joints' springs, which are written together: the polynomial's first coefficient, the others, where it is slack.
OF_SPRINGS: Final = ("jnt_stiffness", "jnt_stiffnesspoly", "qpos_spring")
GRAVITY: Final = "opt.gravity"
HELD: Final = {*OF_JOINTS, *OF_WHOLE_JOINTS, *OF_SPRINGS, *OF_BODIES, *OF_ACTUATORS, GRAVITY}


def holds(model: mujoco.MjModel, wiring: Wiring, entries: Sequence[Entry], period: float, substeps: int) -> bool:
    """Whether a model file can hold an effect, all entries of which are given.

    Args:
        model: compiled, nominal; its physics step is that of the file.
        wiring: its parts.
        entries: of one effect.
        period: of control [s].
        substeps: physics steps in it.
    """
    chain = changed(model, wiring, entries, period, substeps)
    if not all(set(chain.asked) <= HELD or not overrides(effect, "change") for effect in chain.effects):
        return False
    return all(
        not _runs(effect)
        or effect.model_attributes(chain.now) is not None
        or effect.model_tendons(chain.now) is not None
        for effect in chain.effects
    )


def _runs(effect: Effect) -> bool:
    """Whether an effect does anything beside changing the model at the start."""
    return any(acts(effect, hook) for hook in (*EACH_SUBSTEP, *EACH_STEP, "place", "contact_factors"))


def changed(model: mujoco.MjModel, wiring: Wiring, entries: Sequence[Entry], period: float, substeps: int) -> Chain:
    """The effects at work on a copy of the model, which is the chain's host's, at the start of an episode.

    Raises:
        ValueError: an entry names a target that the model does not have.
    """
    host = ScalarHost(mujoco.MjData(copy.copy(model)))
    for adr, joint in zip(wiring.act, wiring.targets.actuated, strict=True):
        if adr >= 0:
            host.state("act")[:, adr] = host.state("qpos")[:, wiring.qpos[joint]]
    runner = Runner(host, wiring, [entries], np.zeros)
    runner.start(period, substeps)
    return runner.chain


def read(path: Path, timestep: float) -> mujoco.MjSpec:
    """A user's file as it can be written to another folder, with a physics step [s].

    Raises:
        ValueError: it does not compile; one line.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    spec.option.timestep = timestep
    # What lies beside the user's file is named from the root: the new file lies elsewhere.
    if any(asset.file for asset in (*spec.meshes, *spec.hfields, *spec.skins)):
        spec.meshdir = str((path.parent / spec.meshdir).resolve())
    if any(_files(texture) for texture in spec.textures):
        spec.texturedir = str((path.parent / spec.texturedir).resolve())
    return spec


def _files(texture: Any) -> bool:
    return bool(texture.file) or any(texture.cubefiles)


def write(
    spec: mujoco.MjSpec, wiring: Wiring, entries: Sequence[Entry], period: float, substeps: int, said: str
) -> str:
    """The file's text.

    Args:
        spec: of :func:`read`; it is changed.
        wiring: parts of the compiled model.
        entries: effects that :func:`holds` is true of.
        period: of control [s].
        substeps: physics steps in it.
        said: a comment at the top.

    Raises:
        ValueError: what was written does not compile to the model that was simulated; one line.
    """
    model = spec.compile()
    chain = changed(model, wiring, entries, period, substeps)
    wanted = chain.now.host.model
    for actuator, attributes in actuator_attributes(chain, wiring).items():
        element = _by_id(spec.actuators)[actuator]
        for name, value in attributes.items():
            setattr(element, name, type(getattr(element, name))(value))
    for _ in range(PASSES):
        if not _copied(spec, spec.compile(), wanted):
            break
    add(spec, tendons_of(chain.effects, chain.now))
    spec.add_text(name=MARK, data="effects are in this file: apply would add them once more")
    if any(actuator.delay > 0 for actuator in spec.actuators):
        said += f"\n{LATE}"
    spec.comment = "\n".join(filter(None, [spec.comment, said.replace("--", "- -")]))
    with _exactly():
        text: str = spec.to_xml()
    _check(text, wanted)
    return text


def tendons_of(effects: Sequence[Effect], now: Now) -> list[Tendon]:
    """Tendons by which MuJoCo does what the effects of a chain do between physics steps."""
    return [one for effect in effects for one in effect.model_tendons(now) or ()]


def actuator_attributes(chain: Chain, wiring: Wiring) -> dict[int, dict[str, float]]:
    """Attributes by which MuJoCo's actuators do what the effects of a chain do between physics steps, by actuator."""
    out: dict[int, dict[str, float]] = {}
    for effect in chain.effects:
        attributes = effect.model_attributes(chain.now) if _runs(effect) else None
        for name, values in (attributes or {}).items():
            for actuator, value, there in zip(wiring.actuators, values[0], _reaches(effect, wiring), strict=True):
                if there:
                    out.setdefault(int(actuator), {})[name] = float(value)
    return out


def _reaches(effect: Effect, wiring: Wiring) -> Array:
    """Where an effect acts, (nactuators,) of booleans."""
    present: Array = effect.present[0]
    return present[list(wiring.targets.actuated)] if effect.targets == "joint" else present


def _by_id(elements: Sequence[Any]) -> dict[int, Any]:
    """Elements of a compiled spec by their place in the model."""
    return {int(element.id): element for element in elements}


def _copied(spec: mujoco.MjSpec, model: mujoco.MjModel, wanted: mujoco.MjModel) -> bool:
    """Copy what differs between two compiled models into the elements that the first is made of; whether any did."""
    joints, bodies, actuators = (_by_id(elements) for elements in (spec.joints, spec.bodies, spec.actuators))
    differ = False
    for field, attribute in OF_JOINTS.items():
        for dof in differing_rows(model, wanted, field):
            element = joints[int(model.dof_jntid[dof])]
            _set(element, attribute, getattr(wanted, field)[dof])
            differ = True
    for field, attribute in OF_WHOLE_JOINTS.items():
        for joint in differing_rows(model, wanted, field):
            _set(joints[joint], attribute, getattr(wanted, field)[joint])
            differ = True
    for joint, (rest, coefficients) in differing_springs(model, wanted).items():
        turns = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE
        joints[joint].stiffness[:] = coefficients
        joints[joint].springref = np.degrees(rest) if turns and spec.compiler.degree else rest
        differ = True
    heavier = dict.fromkeys(row for field in OF_BODIES for row in differing_rows(model, wanted, field))
    for body in heavier:
        bodies[body].explicitinertial = True
        bodies[body].fullinertia = np.full(6, np.nan)
        for field, attribute in OF_BODIES.items():
            _set(bodies[body], attribute, getattr(wanted, field)[body])
        differ = True
    if heavier:
        # Each body's inertia is the one that is written, whatever the compiler did with the user's.
        if spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE:
            spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
        spec.compiler.settotalmass = -1
        spec.compiler.boundmass = spec.compiler.boundinertia = 0
    for field, attribute in OF_ACTUATORS.items():
        for actuator in differing_rows(model, wanted, field):
            _set(actuators[actuator], attribute, getattr(wanted, field)[actuator])
            differ = True
    if not np.array_equal(model.opt.gravity, wanted.opt.gravity):
        spec.option.gravity = wanted.opt.gravity
        differ = True
    return differ


def differing_rows(model: mujoco.MjModel, wanted: mujoco.MjModel, field: str) -> list[int]:
    """Rows of a field in which two models differ by more than rounding."""
    one, other = getattr(model, field), getattr(wanted, field)
    same = np.isclose(one, other, rtol=1e-13, atol=1e-15).reshape(len(one), -1)
    return [int(row) for row in np.flatnonzero(~same.all(axis=1))]


def differing_springs(model: mujoco.MjModel, wanted: mujoco.MjModel) -> dict[int, tuple[float, Array]]:
    """Springs of the wanted model where they are others, by joint: where each is slack [m, rad], and its stiffness as a
    polynomial's coefficients, (3,)."""
    rows = [differing_rows(model, wanted, field) for field in OF_SPRINGS]
    owners = np.searchsorted(model.jnt_qposadr, rows[2], side="right") - 1
    return {
        int(joint): (
            float(wanted.qpos_spring[model.jnt_qposadr[joint]]),
            np.array([wanted.jnt_stiffness[joint], *wanted.jnt_stiffnesspoly[joint]]),
        )
        for joint in sorted({*rows[0], *rows[1], *owners})
    }


def _set(element: Any, attribute: str, value: Any) -> None:
    """Give an element a number, the first of several (a damping, of its polynomial), or a row of them."""
    present = getattr(element, attribute)
    if np.ndim(present) and np.shape(present) != np.shape(value):
        present[: np.size(value)] = value
    elif np.ndim(present):
        present[:] = value
    else:
        setattr(element, attribute, type(present)(value))


def _check(text: str, wanted: mujoco.MjModel) -> None:
    """Refuse a text that is not the model that was simulated."""
    model = mujoco.MjModel.from_xml_string(text)
    for field in sorted(HELD - {GRAVITY}):
        one, other = getattr(model, field), getattr(wanted, field)
        if one.shape != other.shape or not np.allclose(one, other, rtol=ALIKE, atol=1e-9):
            raise ValueError(f"as a file, the model's {field} is not what was simulated")


@contextmanager
def _exactly() -> Iterator[None]:
    """Let MuJoCo write all digits of a number, where its library can be told to; six are what it writes else."""
    digits: Callable[[int], None] | None = None
    before = 6
    for path in sorted(Path(mujoco.__file__).parent.glob("*mujoco*")):
        if path.suffix in (".dll", ".dylib") or ".so" in path.suffixes:
            library = ctypes.CDLL(str(path))
            if hasattr(library, "_mjPRIVATE__set_xml_precision") and hasattr(library, "_mjPRIVATE__get_xml_precision"):
                before = int(library._mjPRIVATE__get_xml_precision())
                digits = library._mjPRIVATE__set_xml_precision
    if digits is not None:
        digits(DIGITS)
    try:
        yield
    finally:
        if digits is not None:
            digits(before)


def by_effect(entries: Sequence[Entry]) -> Mapping[str, tuple[Entry, ...]]:
    """Entries by their effect's name, in the order of the declarations."""
    return {name: own for name in EFFECTS if (own := tuple(entry for entry in entries if entry.name == name))}
