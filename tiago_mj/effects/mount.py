"""What the robot stands on: a table, a pedestal or wheels that give way."""

from __future__ import annotations

from typing import Final, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.declare import Array, Effect, effect
from tiago_mj.effects.fields import parameter
from tiago_mj.effects.now import Now

#: Damping of the mount, as a share of the critical one: structures that are bolted or stand on the floor have 0.01 to
#: 0.1 (chosen).
MOUNT_DAMPING: Final = 0.05
#: Least moment of inertia of what tilts with the robot, as a share of the robot's own about its foot in the reference
#: pose: a robot without any base would swing as fast as its joints let it (chosen).
LEAST_BASE: Final = 0.1
#: What is asked of the simulation in every physics step.
ASKED: Final = ("xpos", "xipos", "ximat", "xaxis", "xanchor")
#: Rounds in which gravity's moment and the tilt that it makes settle at the start: each is nearer by the share that the
#: tilt adds to the moment.
SETTLING_ROUNDS: Final = 10
#: How far joints are taken to give way to a base that accelerates, of what they would without servos and friction. What
#: they do is seen a step later and put right, which converges from joints that are held fast to free ones up to a half,
#: and the faster the more.
YIELDING: Final = 0.5
#: The base tilts about the world's x and y axis, and not about z.
TURNS, TILTS = 3, 2
_NEXT, _AFTER = np.array([1, 2, 0]), np.array([2, 0, 1])


@effect("compliant_mount", stage="body", targets="joint")
class CompliantMount(Effect):
    """The base tilts about its foot, on a table or wheels that give way like a spring.

    The robot's weight and what it needs to accelerate its links tilt the base about both horizontal axes through the
    origin of the first body of the joints' tree, which the world holds; below a robot that stands free nothing gives
    way. Joint angles are of the base, so that a tilt shows as gravity that leans, and as forces of inertia while it
    changes. The spring is slack where the base is level; an episode begins in equilibrium. The damping is 0.05 of the
    critical one. The frequency is that of the base with the robot on it in the model's reference pose, its joints held;
    it is never higher than of a base with a tenth of the robot's moment of inertia. Contacts with what does not stand
    on the base are where they would be on a level one.

    Formula: inertia · tilt'' = moment of the robot - tilt / compliance - damping · tilt'; inertia = 1 / (compliance ·
    (2π · frequency)²)

    In a recording: after starts and stops all joints swing at one low frequency, those at rest, too.

    Typical: 0.01-1 mrad/(N·m): a bolted pedestal, a robot clamped to a desk; 3-15 Hz.

    On the robot: look at a pointer or a phone on the base while the arm stops abruptly: does it rock?

    Source: chosen.

    MuJoCo: two hinges with ``stiffness`` below the base would do it, at the price of two more degrees of freedom; here
    forces on the joints, ``qfrc_applied``.
    """

    subject = "the base"
    clause = "the base tilts by {compliance} and rocks at {frequency}"
    common = True
    fewest_targets = 2
    swing_frequency = "frequency"

    compliance = parameter("rad/(N·m)", identity=0.0, default=0.0005, bounds=(0.0, 0.002))
    frequency = parameter("Hz", identity=None, default=8.0, bounds=(1.0, 40.0))

    def start(self, now: Now) -> None:
        self._tree = _Tree.of(now)
        self._sims = np.flatnonzero(self.present.any(axis=1) & self._tree.held)
        compliance = self.compliance[self._sims]
        total = compliance.sum(axis=1)
        self._stiffness = 1 / total
        self._turning = 2 * np.pi * (compliance * self.frequency[self._sims]).sum(axis=1) / total
        robots = [self._tree.inertia(one) if k in self._sims else 0.0 for k, one in enumerate(now.host.models())]
        self._robot = np.array(robots)[self._sims]
        for name in ASKED:
            now.host.output(name)  # a batch fills what is asked for at its next call: ask before the first
        self._swing: _Swing | None = None

    def added_force(self, now: Now) -> Array:
        force = super().added_force(now)
        if now.host.simulates and len(self._sims):  # along a motion that is given nobody knows how the base moved
            seen = self._tree.seen(now, self._sims)
            if self._swing is None:
                self._swing = _Swing(seen, self._stiffness, self._turning, self._robot)
            force[self._sims] = self._swing.force(seen, (now.period / now.substeps)[self._sims])
        return force


class _Tree(NamedTuple):
    """The joints and the bodies that they move.

    Attributes:
        bodies: that the joints' tree moves, (nbodies,).
        root: the body that the tree hangs on.
        held: whether the world holds that one.
        hinges: whether a joint turns, (njoints,).
        ids: of the joints, (njoints,).
        moves: 1 where a joint moves a body, (nbodies, njoints).
    """

    bodies: NDArray[np.intp]
    root: int
    held: bool
    hinges: NDArray[np.bool_]
    ids: NDArray[np.intp]
    moves: Array

    @classmethod
    def of(cls, now: Now) -> _Tree:
        model, dofs = now.host.model, now.wiring.dof
        joints = model.dof_jntid[dofs]
        root = int(model.body_rootid[model.jnt_bodyid[joints[0]]])
        bodies = np.flatnonzero((model.body_rootid == root) & (model.body_weldid != 0))
        moves = np.zeros((len(bodies), len(joints)))
        for k, body in enumerate(bodies):
            above = int(body)
            while above:
                moves[k, model.jnt_bodyid[joints] == above] = 1.0
                above = int(model.body_parentid[above])
        hinges = model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_HINGE
        first = model.body_jntadr[root]
        free = bool(first >= 0) and model.jnt_type[first] == mujoco.mjtJoint.mjJNT_FREE
        return cls(bodies, root, not free, hinges, joints, moves)

    def inertia(self, model: mujoco.MjModel) -> float:
        """Of the robot about its foot in the model's reference pose, the mean of both axes [kg·m²]."""
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        inertia = 0.0
        for body in self.bodies:
            r, turn = data.xipos[body] - data.xpos[self.root], data.ximat[body].reshape(3, 3)
            arms = float(r @ r) + float(r[2] * r[2])  # squares, from both axes
            own = np.square(turn[:TILTS]) @ model.body_inertia[body]
            inertia += 0.5 * (model.body_mass[body] * arms + float(own.sum()))
        return inertia

    def seen(self, now: Now, sims: NDArray[np.intp]) -> _Seen:
        """What the mount feels of some simulations."""
        host = now.host
        foot, centre, turn, axis, anchor = (host.output(name)[sims] for name in ASKED)
        r = centre[:, self.bodies] - foot[:, None, self.root]
        mass = host.field("body_mass")[sims[:, None], self.bodies]
        turn = turn[:, self.bodies].reshape(len(sims), -1, 3, 3)
        inertia = (turn * host.field("body_inertia")[sims[:, None], self.bodies][:, :, None]) @ turn.swapaxes(-1, -2)
        axis = axis[:, None, self.ids] * self.moves[..., None]
        arms = centre[:, self.bodies, None] - anchor[:, None, self.ids]
        hinges = self.hinges[:, None]
        linear = np.where(hinges, _cross(axis, arms), axis)
        turns = np.broadcast_to(np.eye(TURNS), (*r.shape[:2], TURNS, 3))
        return _Seen(
            r,
            mass,
            inertia,
            np.concatenate([_cross(turns, r[:, :, None]), linear], axis=2),
            np.concatenate([turns, np.where(hinges, axis, 0.0)], axis=2),
            now.joint_velocity[sims],
            # A joint of another tree moves nothing here: what it would weigh does not matter, but may not be 0.
            np.where(self.moves.any(axis=0), host.field("dof_armature")[sims[:, None], now.wiring.dof], 1.0),
            host.field("opt.gravity")[sims],
        )


class _Seen(NamedTuple):
    """Some simulations before a physics step: geometry as of the step before, speeds of now.

    Attributes:
        r: centres of mass from the foot, (n, nbodies, 3) [m].
        mass, inertia: (n, nbodies) [kg], (n, nbodies, 3, 3) [kg·m²] in the world's axes.
        linear, turning: velocity of each centre and rate of turning of each body, by the base's about each axis and by
            the speed of each joint, (n, nbodies, 3 + njoints, 3).
        speed: of the joints, (n, njoints).
        rotor: inertia of the joints' own, (n, njoints).
        gravity: (n, 3) [m/s²].
    """

    r: Array
    mass: Array
    inertia: Array
    linear: Array
    turning: Array
    speed: Array
    rotor: Array
    gravity: Array

    def mass_matrix(self) -> Array:
        """Of the base's turning, without its own inertia, and of the joints, (n, 3 + njoints, 3 + njoints)."""
        n, bodies, count, _ = self.linear.shape
        moved = (self.mass[..., None, None] * self.linear).swapaxes(1, 2).reshape(n, count, 3 * bodies)
        turned = (self.turning @ self.inertia).swapaxes(1, 2).reshape(n, count, 3 * bodies)
        linear, turning = (x.swapaxes(1, 2).reshape(n, count, 3 * bodies) for x in (self.linear, self.turning))
        matrix: Array = moved @ linear.swapaxes(1, 2) + turned @ turning.swapaxes(1, 2)
        own = np.arange(TURNS, count)
        matrix[:, own, own] += self.rotor
        return matrix


class _Swing:
    """The tilt of some bases, from an equilibrium on.

    What the base and the robot have of angular momentum about the foot changes by spring, damper and weight alone; what
    the joints have of it is the base's no more. The acceleration of the base until the next step is solved for together
    with that of the joints, as each moves the other at once; what else moves the joints is taken to be as in the step
    before. The base is held to what its momentum says, so that no error lasts.

    Args:
        seen: at the start.
        stiffness: [N·m/rad], (n,).
        turning: natural frequency [rad/s], (n,).
        robot: moment of inertia of the robot in the model's reference pose [kg·m²], (n,).
    """

    def __init__(self, seen: _Seen, stiffness: Array, turning: Array, robot: Array) -> None:
        n = len(stiffness)
        self._base = np.maximum(stiffness / turning**2 - robot, LEAST_BASE * robot)
        self._stiffness = stiffness[:, None]
        self._damping = 2 * MOUNT_DAMPING * np.sqrt(stiffness * (self._base + robot))[:, None]
        self._tilt = np.zeros((n, 3))
        for _ in range(SETTLING_ROUNDS):
            self._tilt[:, :TILTS] = self._weight(seen) / self._stiffness
        self._momentum = _times(seen.mass_matrix()[:, :TILTS, TURNS:], seen.speed)
        self._given = np.zeros((n, TILTS))  # rate of tilting that the joints have felt
        self._acceleration = np.zeros((n, TILTS))  # of it in the last step
        self._before: tuple[Array, Array] | None = None  # coupling and speeds

    def force(self, seen: _Seen, step: Array) -> Array:
        """Move by a physics step, (n, 1) [s]; what the joints feel of it, (n, njoints) [N, N·m]."""
        with np.errstate(over="ignore", invalid="ignore"):  # who diverges is stopped by who simulates
            return self._force(seen, step)

    def _force(self, seen: _Seen, step: Array) -> Array:
        matrix = seen.mass_matrix()
        coupling, joints = matrix[:, :TILTS, TURNS:], matrix[:, TURNS:, TURNS:]
        whole = matrix[:, :TILTS, :TILTS] + self._base[:, None, None] * np.eye(TILTS)
        rate = _solved(whole, (self._momentum - _times(coupling, seen.speed))[..., None])[..., 0]
        upright = _times(matrix[:, 2, TURNS:][:, None], seen.speed) + _times(matrix[:, 2, :TILTS][:, None], rate)
        momentum = np.concatenate([self._momentum, upright], axis=1)
        moment = self._weight(seen) - self._stiffness * self._tilt[:, :TILTS] - self._damping * rate
        moment -= _cross(_flat(rate), momentum)[:, :TILTS]
        answer = _solved(joints, coupling.swapaxes(1, 2))  # of the joints to what tilts them, (n, njoints, 2)
        rest, changing = np.zeros_like(seen.speed), np.zeros_like(rate)
        if self._before is not None:
            earlier, speed = self._before
            rest = (seen.speed - speed) / step + YIELDING * _times(answer, self._acceleration)
            changing = _times(coupling - earlier, seen.speed) / step
        pushed = moment - _times(coupling, rest) - changing
        accelerated = _solved(whole - YIELDING * coupling @ answer, pushed[..., None])[..., 0]
        after = rate + step * accelerated
        self._acceleration = (after - self._given) / step
        self._given, self._before = after, (coupling, seen.speed)
        self._momentum = self._momentum + step * moment
        force = -_times(coupling.swapaxes(1, 2), self._acceleration) - self._turned(
            seen, _flat(0.5 * (rate + after)), step
        )
        self._tilt = self._tilt + step * _flat(after)
        return force

    def _weight(self, seen: _Seen) -> Array:
        """Moment of the robot's weight about both axes, (n, 2) [N·m]."""
        first = (seen.mass[..., None] * seen.r).sum(axis=1)
        weight: Array = _cross(first, seen.gravity - _cross(self._tilt, seen.gravity))[:, :TILTS]
        return weight

    def _turned(self, seen: _Seen, rate: Array, step: Array) -> Array:
        """What the joints need where gravity leans and the base turns at a rate, (n, 3), for a physics step, (n,
        njoints); to the first order in the tilt."""
        leaning, rate = _cross(self._tilt + 0.5 * step * rate, seen.gravity), rate[:, None]
        linear, turning = seen.linear[:, :, TURNS:], seen.turning[:, :, TURNS:]
        velocity, spin = (np.einsum("nbji,nj->nbi", x, seen.speed) for x in (linear, turning))
        push = seen.mass[..., None] * (2 * _cross(rate, velocity) + leaning[:, None])
        # Of a body that spins: inertia (rate x spin) + spin x (inertia rate) + rate x (inertia spin).
        sizes = np.trace(seen.inertia, axis1=2, axis2=3)[..., None]
        twist = sizes * _cross(rate, spin) - 2 * _cross(_times(seen.inertia, rate), spin)
        out: Array = np.einsum("nbji,nbi->nj", linear, push) + np.einsum("nbji,nbi->nj", turning, twist)
        return out


def _cross(a: Array, b: Array) -> Array:
    """Cross products along the last axis; on arrays as small as these NumPy's own takes five times as long."""
    product: Array = a[..., _NEXT] * b[..., _AFTER] - a[..., _AFTER] * b[..., _NEXT]
    return product


def _flat(horizontal: Array) -> Array:
    """A vector of the world, (n, 3), of its horizontal part, (n, 2)."""
    return np.concatenate([horizontal, np.zeros((len(horizontal), 1))], axis=1)


def _times(matrix: Array, vector: Array) -> Array:
    """Matrices times vectors."""
    product: Array = (matrix @ vector[..., None])[..., 0]
    return product


def _solved(matrix: Array, right: Array) -> Array:
    """What matrices have to be multiplied by to give the right sides."""
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
