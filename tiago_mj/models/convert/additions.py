"""Applying the additions file to the assembled bodies: settings, sites, servos, sensors, exclusions, keyframes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fnmatch import fnmatchcase
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from tiago_mj.effects.body import LinkMass
from tiago_mj.models import gains, stated
from tiago_mj.models.convert import actuators, shapes
from tiago_mj.models.convert.assembly import Assembly
from tiago_mj.models.convert.extras import Extras
from tiago_mj.models.convert.tree import JOINTED
from tiago_mj.models.convert.urdf import Joint

# Names as in MJCF: fields of MjSpec.
BODY_FIELDS = {"gravcomp": "gravcomp"}
JOINT_FIELDS = {
    "armature": "armature",
    "damping": "damping",
    "frictionloss": "frictionloss",
    "stiffness": "stiffness",
    "springref": "springref",
    "range": "range",
    "margin": "margin",
    "actuatorfrcrange": "actfrcrange",
    "actuatorgravcomp": "actgravcomp",
    "solreflimit": "solref_limit",
    "solimplimit": "solimp_limit",
    "solreffriction": "solref_friction",
    "solimpfriction": "solimp_friction",
}
GEOM_FIELDS = {
    key: key
    for key in (
        *("contype", "conaffinity", "condim", "priority", "friction", "solref", "solimp", "solmix"),
        *("margin", "gap", "group", "rgba"),
    )
}
OPTION_ENUMS: dict[str, dict[str, Any]] = {
    "integrator": {
        "Euler": mujoco.mjtIntegrator.mjINT_EULER,
        "RK4": mujoco.mjtIntegrator.mjINT_RK4,
        "implicit": mujoco.mjtIntegrator.mjINT_IMPLICIT,
        "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    },
    "cone": {"pyramidal": mujoco.mjtCone.mjCONE_PYRAMIDAL, "elliptic": mujoco.mjtCone.mjCONE_ELLIPTIC},
}
OPTION_FIELDS = (
    "integrator",
    "cone",
    "impratio",
    "timestep",
    "gravity",
    "iterations",
    "ls_iterations",
    "noslip_iterations",
)
SENSED = {
    "site": mujoco.mjtObj.mjOBJ_SITE,
    "joint": mujoco.mjtObj.mjOBJ_JOINT,
    "actuator": mujoco.mjtObj.mjOBJ_ACTUATOR,
    "body": mujoco.mjtObj.mjOBJ_BODY,
    "geom": mujoco.mjtObj.mjOBJ_GEOM,
}
SITE_KEYS = {"name", "body", "type", "size", "pos", "euler", "rgba", "group"}


def apply(assembly: Assembly) -> None:
    """Apply every addition to ``assembly.spec``.

    Raises:
        ConversionError: a name that does not exist, an unknown setting, a value of the wrong shape.
    """
    spec, extras = assembly.spec, assembly.extras
    _options(spec, extras)
    _settings("bodies", assembly.bodies, extras.bodies, BODY_FIELDS, extras)
    _settings("joints", {j.name: j for j in spec.joints if j.name}, extras.joints, JOINT_FIELDS, extras)
    _settings("geoms", {g.name: g for g in spec.geoms if g.name}, extras.geoms, GEOM_FIELDS, extras)
    for link in (*extras.capsules, *extras.collision):
        if link not in assembly.urdf.links:
            raise extras.error(f'link "{link}" does not exist', "name a link of the URDF")
    for site in extras.sites:
        _site(assembly, site)
    for first, second in (*_fixed_neighbours(assembly), *extras.exclude):
        for name in (first, second):
            if name not in assembly.bodies:
                raise extras.error(f'exclude names "{name}", which is no body', "name a link that is not only a frame")
        spec.add_exclude(bodyname1=first, bodyname2=second)
    _servos(assembly)
    _known_masses(assembly)
    for sensor in extras.sensors:
        _sensor(spec, sensor, extras)
    _keyframes(spec, extras)


def _fixed_neighbours(assembly: Assembly) -> Iterable[tuple[str, str]]:
    """Pairs of a moving link and the links fixed in the world around its joint.

    MuJoCo ignores contacts between a body and its parent, but not when the parent is fixed in the world; this makes
    it the same.
    """
    fixed = [name for name in assembly.bodies if assembly.moving[name] is None]
    for joint in assembly.urdf.joints.values():
        if joint.kind == "fixed" or assembly.moving.get(joint.parent, "") is not None:
            continue
        group = [name for name, mover in assembly.moving.items() if mover == joint.child and name in assembly.bodies]
        for mover in group:
            yield from (
                (mover, still) for still in fixed if _may_collide(assembly.bodies[mover], assembly.bodies[still])
            )


def _may_collide(first: Any, second: Any) -> bool:
    """Whether the collision bits let any geom of one body meet any of the other."""
    return any(a.contype & b.conaffinity or b.contype & a.conaffinity for a in first.geoms for b in second.geoms)


def assign(element: Any, attribute: str, value: Any) -> None:
    """Set a field of MjSpec; a vector may be given short (the rest stays) or as a scalar.

    Raises:
        ValueError, TypeError: a value of the wrong kind or too long.
    """
    current = getattr(element, attribute)
    if isinstance(current, np.ndarray):
        values = np.atleast_1d(np.asarray(value, dtype=float))
        filled = np.array(current)
        if values.ndim != 1 or len(values) > len(filled) or not np.isfinite(values).all():
            raise ValueError
        filled[: len(values)] = values
        setattr(element, attribute, filled)
    elif isinstance(value, (bool, int, float)):
        kind = type(current)
        setattr(element, attribute, kind(value) if kind in (bool, int, float) else value)
    else:
        raise TypeError


def _settings(
    what: str, elements: Mapping[str, Any], patterns: Mapping[str, Any], known: Mapping[str, str], extras: Extras
) -> None:
    for pattern, settings in patterns.items():
        matched = [element for name, element in elements.items() if fnmatchcase(name, pattern)]
        if not matched:
            names = ", ".join(list(elements)[:8])
            raise extras.error(
                f'{what}: "{pattern}" matches nothing', f"there are {names}{' ...' if len(elements) > 8 else ''}"
            )
        if not isinstance(settings, Mapping):
            raise extras.error(f'{what}: "{pattern}" is not a mapping', f"give some of {', '.join(known)}")
        for key, value in settings.items():
            if key not in known:
                raise extras.error(f'{what}: "{pattern}" has the unknown setting "{key}"', f"use {', '.join(known)}")
            for element in matched:
                try:
                    assign(element, known[key], value)
                except (TypeError, ValueError):
                    mend = "give a number, or a list of as many numbers as MJCF takes"
                    raise extras.error(f'{what}: "{pattern}": {key}: {value!r} does not fit', mend) from None


def _options(spec: mujoco.MjSpec, extras: Extras) -> None:
    for key, value in extras.option.items():
        if key not in OPTION_FIELDS:
            raise extras.error(f'option has the unknown setting "{key}"', f"use {', '.join(OPTION_FIELDS)}")
        if key in OPTION_ENUMS:
            if value not in OPTION_ENUMS[key]:
                raise extras.error(f'option {key}: "{value}" does not exist', f"use {', '.join(OPTION_ENUMS[key])}")
            setattr(spec.option, key, OPTION_ENUMS[key][value])
            continue
        try:
            assign(spec.option, key, value)
        except (TypeError, ValueError):
            raise extras.error(f"option {key}: {value!r} does not fit", "give a number") from None


def _site(assembly: Assembly, site: Mapping[str, Any]) -> None:
    extras = assembly.extras
    unknown = set(site) - SITE_KEYS
    if unknown or not {"name", "body"} <= set(site):
        what = f"site {dict(site)!r} has unknown or missing keys"
        raise extras.error(
            what, f"give name and body, and of the rest {', '.join(sorted(SITE_KEYS - {'name', 'body'}))}"
        )
    if site["body"] not in assembly.bodies:
        raise extras.error(f'site "{site["name"]}": body "{site["body"]}" does not exist', "name a link of the URDF")
    kind = site.get("type", "sphere")
    if kind not in shapes.GEOM_TYPES or kind == "mesh":
        raise extras.error(f'site "{site["name"]}": type "{kind}" does not exist', "use box, sphere, capsule, cylinder")
    quat = shapes.quaternion(Rotation.from_euler("XYZ", site.get("euler", (0, 0, 0))))
    added = assembly.bodies[site["body"]].add_site(
        name=site["name"],
        type=shapes.GEOM_TYPES[kind],
        pos=site.get("pos", [0.0] * 3),
        quat=quat,
        group=site.get("group", 4),
    )
    for key in ("size", "rgba"):
        if key in site:
            try:
                assign(added, key, site[key])
            except (TypeError, ValueError):
                raise extras.error(
                    f'site "{site["name"]}": {key} does not fit', "give up to 3 sizes, 4 colours"
                ) from None


def _servos(assembly: Assembly) -> None:
    """Servos as the additions say; without any, intvelocity servos with gains from the effort limits."""
    spec, extras = assembly.spec, assembly.extras
    joints = {
        name: joint
        for name, joint in assembly.urdf.joints.items()
        if joint.kind in JOINTED and joint.mimic is None and spec.joint(name) is not None
    }
    chosen: dict[str, dict[str, Any]] = {name: {} for name in joints}
    for pattern, settings in extras.actuators.items():
        matched = [name for name in joints if fnmatchcase(name, pattern)]
        if not matched:
            raise extras.error(f'actuators: "{pattern}" matches no joint', f"there are {', '.join(joints)}")
        if not isinstance(settings, Mapping) or set(settings) - set(actuators.SETTINGS):
            raise extras.error(f'actuators: "{pattern}" has unknown settings', f"use {', '.join(actuators.SETTINGS)}")
        for name in matched:
            chosen[name] |= settings
    inertias = _joint_inertias(spec)
    known: dict[tuple[str | None, str], gains.Gain] = {}
    for name, settings in chosen.items():
        joint = joints[name]
        kind = settings.get("type", "intvelocity")
        if kind not in actuators.KINDS:
            raise extras.error(f'actuators: type "{kind}" does not exist', f"use one of {', '.join(actuators.KINDS)}")
        if kind == "none":
            continue
        told = {gain: gains.of(assembly.options.gains, name, gain) for gain in gains.GAINS}
        settings = {**settings, **{gain: said.value for gain, said in told.items() if said and said.value is not None}}
        if joint.effort is None and "kp" not in settings and "kv" not in settings and kind != "motor":
            assembly.added.append(f"joint {name}: no servo, for the URDF gives no effort limit to choose gains by")
            continue
        kp, kv = _gains(joint, inertias[name], settings, extras)
        actuators.add(spec, actuators.Servo(joint, kind, kp, kv, settings))
        guessed = "kp" not in settings and kind != "motor"
        if guessed:
            assembly.added.append(f"joint {name}: {kind} servo, kp {kp:.4g}, kv {kv:.4g}, guessed: see --gains")
        for gain, said in told.items():
            known_to = said.known_to if said else gains.GUESSED if guessed else None
            if known_to is not None and kind != "motor":
                known[name, gain] = gains.Gain(None, known_to)
    if known:
        spec.add_text(name=gains.TEXT, data=gains.written(known))


def _known_masses(assembly: Assembly) -> None:
    """How well the model says that its links' masses are known."""
    share = assembly.options.masses
    if share is not None and any(joint.kind in JOINTED for joint in assembly.urdf.joints.values()):
        assembly.spec.add_text(name=stated.UNCERTAINTY, data=stated.written({LinkMass.name: share}))
        assembly.added.append(f"masses of the links: a diagnosis takes them as known to {100 * share:g} %")


def _gains(joint: Joint, inertia: float, settings: Mapping[str, Any], extras: Extras) -> tuple[float, float]:
    kp, kv = actuators.default_gains(joint, inertia)
    try:
        kp = float(settings.get("kp", kp))
        kv = float(settings.get("kv", 0.0 if "kp" in settings else kv))
    except (TypeError, ValueError):
        raise extras.error(
            f'actuators: the gains of "{joint.name}" are not numbers', "give kp and kv as numbers"
        ) from None
    if min(kp, kv) < 0:
        raise extras.error(f'actuators: a gain of "{joint.name}" is negative', "give kp and kv of zero or more")
    return kp, kv


def _joint_inertias(spec: mujoco.MjSpec) -> dict[str, float]:
    """Diagonal of the mass matrix at the initial pose, by joint."""
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    dense = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, dense)
    return {model.joint(i).name: float(dense[a, a]) for i in range(model.njnt) if (a := int(model.jnt_dofadr[i])) >= 0}


def _sensor(spec: mujoco.MjSpec, sensor: Mapping[str, Any], extras: Extras) -> None:
    kind = getattr(mujoco.mjtSensor, f"mjSENS_{str(sensor.get('type', '')).upper()}", None)
    objects = [key for key in SENSED if key in sensor]
    if kind is None or "name" not in sensor or len(objects) != 1 or set(sensor) - {"type", "name", *SENSED}:
        mend = f"give type (as in MJCF), name and one of {', '.join(SENSED)}"
        raise extras.error(f"sensor {dict(sensor)!r} is not understood", mend)
    (sensed,) = objects
    if getattr(spec, sensed)(sensor[sensed]) is None:
        raise extras.error(
            f'sensor "{sensor["name"]}": {sensed} "{sensor[sensed]}" does not exist', "name one that does"
        )
    spec.add_sensor(name=sensor["name"], type=kind, objtype=SENSED[sensed], objname=sensor[sensed])


def _keyframes(spec: mujoco.MjSpec, extras: Extras) -> None:
    if not extras.keyframes:
        return
    model = spec.compile()
    for name, pose in extras.keyframes.items():
        qpos, act, ctrl = np.array(model.qpos0), np.zeros(model.na), np.zeros(model.nu)
        for joint, value in pose.items():
            index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
            if index < 0 or not isinstance(value, (int, float)):
                raise extras.error(
                    f'keyframe "{name}": "{joint}: {value}" is no joint and value', "name joints of the URDF"
                )
            qpos[model.jnt_qposadr[index]] = value
            servo = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, joint)
            if servo >= 0 and model.actuator_actadr[servo] >= 0:
                act[model.actuator_actadr[servo]] = value  # the set point of an integrated-velocity servo
            elif servo >= 0 and model.actuator_biastype[servo] == mujoco.mjtBias.mjBIAS_AFFINE:
                ctrl[servo] = value if model.actuator_biasprm[servo][1] != 0 else 0.0
        spec.add_key(name=name, qpos=qpos, act=act, ctrl=ctrl)
