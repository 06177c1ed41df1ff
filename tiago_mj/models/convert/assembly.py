"""Assembly of the bodies: one MuJoCo body per link, with its joint, inertia and shapes.

No link is fused away: names stay addressable. A link that carries nothing and hangs on a fixed joint is a site, which
costs nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from tiago_mj.models.convert import inertia, meshes, primitives, shapes
from tiago_mj.models.convert.errors import ConversionError
from tiago_mj.models.convert.extras import Extras
from tiago_mj.models.convert.report import FittedShape
from tiago_mj.models.convert.shapes import GEOM_TYPES, Primitive
from tiago_mj.models.convert.tree import JOINTED, Tree
from tiago_mj.models.convert.urdf import Joint, Link, Mimic, Shape, Urdf
from tiago_mj.models.gains import Gains
from tiago_mj.models.limits import user_field
from tiago_mj.models.stated import URDF_MASSES

COLLISION_GROUP, VISUAL_GROUP, FRAME_GROUP = 3, 2, 4


#: What :class:`Options` may choose from.
COLLISIONS = ("primitives", "mesh", "none")
VISUALS = ("mesh", "primitives", "none")
BASES = ("fixed", "free")


@dataclass(frozen=True)
class Options:
    """How to convert.

    Attributes:
        package_paths: folders that hold the packages of ``package://`` addresses, before ``ROS_PACKAGE_PATH`` and the
            URDF's parents.
        collision: ``primitives`` keeps the URDF's primitives and fits one to each mesh; ``mesh`` keeps meshes (MuJoCo
            collides their convex hulls); ``none``.
        visual: ``mesh`` keeps meshes, ``primitives`` fits them, ``none``.
        base: ``fixed`` fixes the root link in the world, ``free`` gives it a free joint.
        mass_floor: mass [kg] for links that move and have none; None refuses them.
        scene: whether the model has a light and a floor, below the robot where it stands at rest. A robot with a free
            base stands on it; below one that is fixed in the world it is only seen.
        gains: of servos, and what they are known to (:mod:`tiago_mj.models.gains`).
        masses: one standard deviation of the logarithm of every link's mass, which the model states for diagnoses
            (:mod:`tiago_mj.models.stated`); None: it states none.

    Raises:
        ConversionError: a choice that does not exist.
    """

    package_paths: tuple[Path, ...] = ()
    collision: str = "primitives"
    visual: str = "mesh"
    base: str = "fixed"
    mass_floor: float | None = None
    scene: bool = True
    gains: Gains = field(default_factory=dict)
    masses: float | None = URDF_MASSES

    def __post_init__(self) -> None:
        for name, value, known in (
            ("collision", self.collision, COLLISIONS),
            ("visual", self.visual, VISUALS),
            ("base", self.base, BASES),
        ):
            if value not in known:
                raise ConversionError(name, f'"{value}" does not exist', f"use one of {', '.join(known)}")


@dataclass
class Assembly:
    """A model under construction, and what happened on the way."""

    urdf: Urdf
    tree: Tree
    extras: Extras
    options: Options
    mesh_folder: str
    spec: mujoco.MjSpec = field(default_factory=mujoco.MjSpec)
    bodies: dict[str, Any] = field(default_factory=dict)
    moving: dict[str, str | None] = field(
        default_factory=dict
    )  # link: the link that moves it, None when fixed in the world
    repaired: list[inertia.InertiaRepair] = field(default_factory=list)
    fitted: list[FittedShape] = field(default_factory=list)
    added: list[str] = field(default_factory=list)
    _mesh_names: dict[tuple[Path, tuple[float, ...]], str] = field(default_factory=dict)
    _geom_names: set[str] = field(default_factory=set)

    def build(self) -> None:
        """Add every link and joint of the URDF."""
        self._set_up()
        joint_of = {joint.child: joint for joint in self.urdf.joints.values()}
        for name in self.tree.order():
            self._add_link(self.urdf.links[name], joint_of.get(name))
        self._check_masses()
        for joint in self.urdf.joints.values():
            if joint.mimic is not None and joint.kind in JOINTED:
                self._add_mimic(joint.name, joint.mimic)

    def _add_mimic(self, joint: str, mimic: Mimic) -> None:
        equality = self.spec.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT, name1=joint, name2=mimic.joint
        )
        polynomial = np.zeros(len(equality.data))  # of the other joint's position
        polynomial[:2] = mimic.offset, mimic.multiplier
        equality.data = polynomial

    def _set_up(self) -> None:
        spec = self.spec
        spec.modelname = self.urdf.name
        spec.compiler.degree = False
        spec.compiler.autolimits = True
        # The file holds what is written here, not what the compiler made of it: full precision, gains as gains.
        spec.compiler.savecompiled = False
        spec.compiler.savecanonical = False
        # Servos from the URDF's limits are stiff: with MuJoCo's default, which steps their damping explicitly, they
        # shake once a link is lighter in some pose than at rest.
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        collision, visual = spec.add_default("collision", spec.default), spec.add_default("visual", spec.default)
        collision.geom.group, visual.geom.group = COLLISION_GROUP, VISUAL_GROUP
        collision.geom.mass = visual.geom.mass = 0.0  # all mass comes from the URDF's inertials
        collision.geom.rgba = [0.9, 0.4, 0.3, 0.5]
        visual.geom.contype = visual.geom.conaffinity = 0

    def _add_link(self, link: Link, joint: Joint | None) -> None:
        parent = self.spec.worldbody if joint is None else self.bodies[joint.parent]
        pose: dict[str, Any] = {}
        if joint is not None:
            pose = {"pos": joint.pose.xyz, "quat": shapes.quaternion(shapes.rotation(joint.pose))}
        if joint is not None and joint.kind == "fixed" and self._is_bare(link):
            parent.add_site(name=link.name, group=FRAME_GROUP, size=[0.005] * 3, **pose)
            return
        if joint is not None and joint.kind == "floating":
            if joint.parent != self.tree.root or self.options.base == "free":
                mend = "MuJoCo has free joints at the root only: attach this part separately"
                raise ConversionError(joint.where, "is a floating joint away from the root", mend)
            parent = self.spec.worldbody
        if link.name == "world" and (joint is not None or self.options.base == "free"):
            raise ConversionError(link.where, "is named world and moves", "rename it: MuJoCo's world is fixed")
        # A root link named world is MuJoCo's own.
        body = parent if link.name == "world" else parent.add_body(name=link.name, **pose)
        self.bodies[link.name] = body
        if joint is None:
            self.moving[link.name] = link.name if self.options.base == "free" else None
            if self.options.base == "free":
                body.add_freejoint(name="root")
        else:
            self.moving[link.name] = self.moving[joint.parent] if joint.kind == "fixed" else link.name
            self._add_joint(body, joint)
        self._add_inertial(body, link)
        if self.options.visual != "none":
            for shape in link.visuals:
                self._add_visual(body, link, shape)
        self._add_collisions(body, link)

    def _is_bare(self, link: Link) -> bool:
        """Whether a link is only a frame: no mass, no shape, nothing hanging from it."""
        massless = link.inertial is None or link.inertial.mass == 0
        given = link.name in self.extras.collision
        return massless and not given and not (link.visuals or link.collisions or self.tree.children[link.name])

    def _add_joint(self, body: Any, joint: Joint) -> None:
        if joint.kind == "floating":
            body.add_freejoint(name=joint.name)
            return
        if joint.kind == "planar":
            normal = np.array(joint.axis) / np.linalg.norm(joint.axis)
            along = np.eye(3)[int(np.argmin(np.abs(normal)))]
            first = np.cross(normal, along) / np.linalg.norm(np.cross(normal, along))
            for suffix, axis in (("x", first), ("y", np.cross(normal, first))):
                body.add_joint(name=f"{joint.name}_{suffix}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
            body.add_joint(name=f"{joint.name}_turn", type=mujoco.mjtJoint.mjJNT_HINGE, axis=normal)
            return
        if joint.kind == "fixed":
            return
        slide = joint.kind == "prismatic"
        added = body.add_joint(
            name=joint.name,
            type=mujoco.mjtJoint.mjJNT_SLIDE if slide else mujoco.mjtJoint.mjJNT_HINGE,
            axis=joint.axis,
            frictionloss=joint.friction,
            userdata=user_field(joint.velocity, joint.soft),
        )
        added.damping = [joint.damping, *[0.0] * (len(added.damping) - 1)]
        if joint.range is not None:
            added.range = joint.range
        if joint.effort is not None:
            added.actfrcrange = [-joint.effort, joint.effort]

    def _add_inertial(self, body: Any, link: Link) -> None:
        if link.inertial is None or link.inertial.mass == 0 or link.name == "world":
            return
        turn = shapes.rotation(link.inertial.pose).as_matrix()
        tensor, repair = inertia.repair(link.name, link.inertial.mass, turn @ link.inertial.inertia @ turn.T)
        if repair is not None:
            self.repaired.append(repair)
        self._set_inertial(body, link.inertial.mass, link.inertial.pose.xyz, tensor)

    @staticmethod
    def _set_inertial(body: Any, mass: float, com: Any, tensor: Any) -> None:
        body.mass, body.ipos, body.explicitinertial = mass, com, True
        body.fullinertia = [tensor[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]

    def _check_masses(self) -> None:
        """Every part that moves needs a mass: its own, or that of a link fixed to it."""
        masses: dict[str, float] = {}
        for name, mover in self.moving.items():
            own = self.urdf.links[name].inertial
            if mover is not None:
                masses[mover] = masses.get(mover, 0.0) + (own.mass if own else 0.0)
        for name, mass in masses.items():
            if mass > 0:
                continue
            if self.options.mass_floor is None:
                mend = "add an <inertial>, or convert with --mass-floor KG"
                raise ConversionError(self.urdf.links[name].where, "moves and has no mass", mend)
            floor = self.options.mass_floor
            self._set_inertial(
                self.bodies[name], floor, [0.0] * 3, np.eye(3) * floor * inertia.SMALLEST_RADIUS_OF_GYRATION**2
            )
            self.added.append(f"link {name}: mass floor {floor:g} kg")

    def _add_visual(self, body: Any, link: Link, shape: Shape) -> None:
        default = self.spec.find_default("visual")
        rgba = shape.rgba
        if shape.kind != "mesh":
            geom = self._add_primitive(body, default, shapes.from_urdf(shape))
        else:
            path = meshes.resolve(shape, self.urdf.path, self.options.package_paths)
            mesh = meshes.load(shape, path)
            rgba = rgba or meshes.color(mesh)
            if self.options.visual == "primitives":
                geom = self._add_primitive(body, default, self._fit(link, shape, mesh, path))
            else:
                geom = self._add_mesh(body, default, shape, mesh, path)
        if rgba is not None:
            geom.rgba = rgba

    def _add_collisions(self, body: Any, link: Link) -> None:
        given = self.extras.collision.get(link.name)
        if self.options.collision == "none" or given == "none":
            return
        default = self.spec.find_default("collision")
        if given is not None:
            for entry in given:
                primitive = primitive_from_extras(entry, self.extras)
                self._add_primitive(body, default, primitive).name = self._geom_name(link, entry.get("name"))
            return
        for shape in link.collisions:
            if shape.kind != "mesh":
                geom = self._add_primitive(
                    body, default, shapes.from_urdf(shape, capsule=link.name in self.extras.capsules)
                )
            else:
                path = meshes.resolve(shape, self.urdf.path, self.options.package_paths)
                mesh = meshes.load(shape, path)
                if self.options.collision == "primitives":
                    geom = self._add_primitive(body, default, self._fit(link, shape, mesh, path))
                else:
                    geom = self._add_mesh(body, default, shape, mesh, path)
            geom.name = self._geom_name(link, shape.name)

    def _geom_name(self, link: Link, given: str | None) -> str:
        base = given or f"{link.name}_collision"
        name, count = base, 1
        while name in self._geom_names:
            count += 1
            name = f"{base}_{count}"
        self._geom_names.add(name)
        return name

    @staticmethod
    def _add_primitive(body: Any, default: Any, primitive: Primitive) -> Any:
        size = [*primitive.size, 0.0, 0.0, 0.0][:3]
        return body.add_geom(
            default, type=GEOM_TYPES[primitive.kind], size=size, pos=primitive.pos, quat=primitive.quat
        )

    def _fit(self, link: Link, shape: Shape, mesh: Any, path: Path) -> Primitive:
        """The best primitive, moved from the mesh's frame to the link's."""
        found = primitives.fit(mesh)
        self.fitted.append(
            FittedShape(link.name, path.name, found.primitive.kind, found.rms_distance, found.volume_ratio)
        )
        return shapes.moved(found.primitive, shape.pose)

    def _add_mesh(self, body: Any, default: Any, shape: Shape, mesh: Any, path: Path) -> Any:
        key = (path, shape.size)
        if key not in self._mesh_names:
            stems = set(self._mesh_names.values())
            name, count = path.stem, 1
            while name in stems:
                count += 1
                name = f"{path.stem}_{count}"
            self._mesh_names[key] = name
            file = f"{self.mesh_folder}/{name}.stl"
            self.spec.assets = {**self.spec.assets, file: mesh.export(file_type="stl")}
            # Shell: visual meshes are often open, and the mass comes from the inertials anyway.
            self.spec.add_mesh(name=name, file=file, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
        place = {"pos": shape.pose.xyz, "quat": shapes.quaternion(shapes.rotation(shape.pose))}
        return body.add_geom(default, type=GEOM_TYPES["mesh"], meshname=self._mesh_names[key], **place)


def primitive_from_extras(entry: Any, extras: Extras) -> Primitive:
    """A shape of the additions file: ``{box: [half sizes], pos: [...], euler: [...]}``, and so on.

    Raises:
        ConversionError: not a known shape, or sizes of the wrong number.
    """
    counts = {"box": 3, "cylinder": 2, "capsule": 2, "sphere": 1}
    kinds = [kind for kind in counts if isinstance(entry, dict) and kind in entry]
    if len(kinds) != 1:
        raise extras.error(f"collision entry {entry!r} is not a shape", f"give one of {', '.join(counts)}")
    (kind,) = kinds
    try:
        size = tuple(float(value) for value in np.atleast_1d(entry[kind]))
        pos = tuple(float(value) for value in entry.get("pos", (0, 0, 0)))
        turn = Rotation.from_euler("XYZ", [float(value) for value in entry.get("euler", (0, 0, 0))])
    except (TypeError, ValueError):
        size, pos, turn = (), (), None
    if len(size) != counts[kind] or min(size) <= 0 or len(pos) != 3:
        mend = f"give {counts[kind]} positive sizes, and pos and euler of 3 numbers each"
        raise extras.error(f"collision entry {entry!r} is not a {kind}", mend)
    return Primitive(kind, size, pos, shapes.quaternion(turn))
