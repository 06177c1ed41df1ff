"""Contact stiffness K [N/m] and damping C [N·s/m] for a pair of MuJoCo geoms, by the exact law.

Users of Bullet state a contact as a spring and a damper. MuJoCo states it as ``solref`` and ``solimp``, whose effect on
the force depends on the bodies' masses and on the number of contact points. In the direct format, with a constant
impedance d and n contact points that share the load, MuJoCo's contact model (its manual, *Computation: Parameters* and
*Modeling: Solver parameters*) is, for the total force f over the approach δ of the two bodies,

    f = K δ + C δ̇ + M δ̈,   stiffness = K (1 - d) Â / n,   damping = C (1 - d) Â / n,   M = n d / ((1 - d) Â),
    solref = (-stiffness, -damping),   solimp = (d, d, ...),

where Â [1/kg] is the sum of the two bodies' translational inverse weights (:func:`inverse_weight`). K and C are totals:
the pad's force over the approach, however many contact points share it.

Two artefacts come with it, and no choice of parameters removes them (``docs/compliance.md`` has the measurements):

* **Virtual mass** M: the contact behaves as if a mass M [kg] sat between pad and object that only resists *relative*
  acceleration. It changes no static force, but rounds impacts and slows the force's rise. It grows with d.
* **Friction creep**: a held object under a tangential load f_t slides at f_t / (C · impratio) instead of sticking. It
  does not depend on d. Raise ``impratio`` or give the friction its own, larger damping (``friction_damping``).

The usual way: an explicit ``<contact><pair>`` between pad and object, then :func:`set_pair_compliance` on the compiled
model. A pair overrides every mixing rule. Where pairs cannot be used, give one geom a higher ``priority`` and write
:func:`contact_parameters`' values to it: with equal priorities MuJoCo takes the element-wise minimum of the two
``solref`` and averages the two ``solimp``, and neither K nor C is what was asked.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from tiago_mj.models.contact_points import inverse_weight, pair_contact_points, pair_index, shared_contact_points

Array = NDArray[np.float64]

__all__ = [
    "BULLET_UNSET",
    "DEFAULT_IMPEDANCE",
    "RIGID",
    "Compliance",
    "ContactParameters",
    "contact_parameters",
    "in_series",
    "inverse_weight",
    "least_impedance",
    "pair_contact_points",
    "set_pair_compliance",
    "shared_contact_points",
    "stability_number",
    "virtual_mass_bound",
    "with_bullet_step_damping",
]

#: Impedance used where none is given: the smallest virtual mass that the usual time steps bear at 10 kN/m and
#: 100 N·s/m, measured in docs/compliance.md.
DEFAULT_IMPEDANCE: Final = 0.5

#: MuJoCo clamps impedances to this range (mjMINIMP, mjMAXIMP), so beyond it the law would not hold.
IMPEDANCE_RANGE: Final = (1e-4, 0.9999)

#: A contact is stable where h·b + h²·k/2 < 2 (derived at :func:`stability_number`).
STABILITY_LIMIT: Final = 2.0

#: Largest stability number that is accepted: 20 % below the limit, so that a change of Â by the pose (MuJoCo freezes it
#: at qpos0) and a body added to the finger do not tip a model over that was checked once.
ACCEPTED_STABILITY_NUMBER: Final = 0.8 * STABILITY_LIMIT

#: Damping [N·s/m] that Bullet gives a body whose contact damping was never set (btCollisionObject).
BULLET_UNSET_DAMPING: Final = 0.1

#: Width, midpoint and power of MuJoCo's impedance curve: without effect while the impedance is constant (the defaults).
_SOLIMP_TAIL: Final = (0.001, 0.5, 2.0)


def _numbers(name: str, value: ArrayLike, valid: Callable[[Array], Any], needed: str) -> Array:
    try:
        array = np.asarray(value, float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be {needed}, got {value!r}") from None
    good = np.asarray(valid(array)) & ~np.isnan(array)
    if np.count_nonzero(good) < good.size:  # a tenth of the time of np.all
        bad = array[~good].flat[0]
        raise ValueError(f"{name} must be {needed}, got {bad:g}")
    return array


def _broadcast(**arrays: Array) -> list[Array]:
    try:
        return [np.array(a) for a in np.broadcast_arrays(*arrays.values())]
    except ValueError:
        shapes = ", ".join(f"{name} {a.shape}" for name, a in arrays.items())
        raise ValueError(f"shapes do not broadcast: {shapes}") from None


@dataclass(frozen=True)
class Compliance:
    """A linear spring and damper between two bodies, or one body's share of it.

    Args:
        stiffness: total force over approach [N/m], > 0; ``inf`` for a rigid body in :func:`in_series`.
        damping: total force over approach speed [N·s/m], >= 0.

    Both may be arrays (one value per simulation); they broadcast against each other.

    Raises:
        ValueError: a stiffness <= 0, a damping < 0 or infinite, NaN, or shapes that do not broadcast.
    """

    stiffness: ArrayLike
    damping: ArrayLike

    def __post_init__(self) -> None:
        stiffness = _numbers("stiffness [N/m]", self.stiffness, lambda x: x > 0, "positive")
        damping = _numbers("damping [N·s/m]", self.damping, lambda x: (x >= 0) & np.isfinite(x), "finite and >= 0")
        _broadcast(stiffness=stiffness, damping=damping)


#: A body that does not yield: it leaves the other's stiffness and damping as they are.
RIGID: Final = Compliance(np.inf, 0.0)

#: What Bullet takes for a body whose contact stiffness and damping were never set.
BULLET_UNSET: Final = Compliance(np.inf, BULLET_UNSET_DAMPING)


@dataclass(frozen=True)
class ContactParameters:
    """MuJoCo parameters of a contact, and the virtual mass that they add.

    Attributes:
        solref: (..., 2), direct format.
        solimp: (..., 5), constant impedance.
        solref_friction: (..., 2), zeros where the friction rows use ``solref``. Elliptic cones only.
        virtual_mass: (...,) [kg], in total over all contact points.
    """

    solref: Array
    solimp: Array
    solref_friction: Array
    virtual_mass: Array


def in_series(a: Compliance, b: Compliance) -> Compliance:
    """Compliance of two bodies in contact by Bullet's rule: 1/k = 1/k₁ + 1/k₂, c = c₁ + c₂.

    (Two dampers in true series would not add; this is what Bullet's btManifoldResult computes.) A body without values
    of its own is :data:`RIGID`; what Bullet takes for it is :data:`BULLET_UNSET`, which adds 0.1 N·s/m.

    Raises:
        ValueError: shapes that do not broadcast.
    """
    ka, kb, ca, cb = _broadcast(
        stiffness_a=np.asarray(a.stiffness, float),
        stiffness_b=np.asarray(b.stiffness, float),
        damping_a=np.asarray(a.damping, float),
        damping_b=np.asarray(b.damping, float),
    )
    with np.errstate(divide="ignore"):
        stiffness = 1.0 / (1.0 / ka + 1.0 / kb)
    return Compliance(stiffness[()], (ca + cb)[()])


def with_bullet_step_damping(compliance: Compliance, bullet_timestep: ArrayLike) -> Compliance:
    """Compliance of a contact as Bullet integrates it: damping c + k·dt at its time step dt.

    Args:
        compliance: stiffness [N/m] and damping [N·s/m] as given to Bullet.
        bullet_timestep: Bullet's physics step [s].
    """
    dt = _numbers("bullet_timestep [s]", bullet_timestep, lambda x: (x > 0) & np.isfinite(x), "positive and finite")
    stiffness = _numbers("stiffness [N/m]", compliance.stiffness, np.isfinite, "finite")
    return Compliance(compliance.stiffness, (np.asarray(compliance.damping, float) + stiffness * dt)[()])


def stability_number(
    compliance: Compliance,
    inverse_weight: ArrayLike,
    *,
    contact_points: ArrayLike,
    impedance: ArrayLike,
    timestep: float,
) -> Array:
    """h·b + h²·k/2 of the contact's reference dynamics, (...,): stable below 2 whatever the bodies' masses.

    MuJoCo's solver finds the acceleration with the spring and damper evaluated at the *current* state, and the step is
    semi-implicit Euler. With m the mass felt at the contact, one step of m ẍ = -(K x + C ẋ + M ẍ) is

        v⁺ = v - h (C v + K x) / (m + M),   x⁺ = x + h v⁺,

    whose characteristic polynomial z² - (2 - h c - h² k) z + (1 - h c), c = C/(m + M), k = K/(m + M), lies inside the
    unit circle exactly where h c + h² k / 2 < 2 (Jury). The least favourable mass is m = 0, which leaves
    (h C + h² K / 2) / M < 2: a bound for every body, any number of points and every direction of motion, because the
    condition holds row by row as an inequality of quadratic forms. Friction rows have M and C both multiplied by
    impratio and no spring: h C / M < 2. A weakly damped contact beside implicit joint damping needs
    :func:`virtual_mass_bound` too.
    ``refsafe`` does not guard the direct format, so nothing else would tell.
    """
    k, c, inverse, points, d = _law_inputs(compliance, inverse_weight, contact_points, impedance)
    mass = points * d / ((1.0 - d) * inverse)
    return np.asarray((timestep * c + timestep**2 * k / 2.0) / mass)


def contact_parameters(
    compliance: Compliance,
    inverse_weight: ArrayLike,
    *,
    contact_points: ArrayLike,
    impedance: ArrayLike = DEFAULT_IMPEDANCE,
    timestep: float,
    friction_damping: ArrayLike | None = None,
) -> ContactParameters:
    """``solref`` and ``solimp`` that give a contact a total stiffness K and damping C; module docstring: the law.

    Args:
        compliance: totals over the contact.
        inverse_weight: Â [1/kg] of the two bodies, :func:`inverse_weight`.
        contact_points: how many points share the load, :func:`shared_contact_points`.
        impedance: d in (0, 1), constant.
        timestep: physics step h [s] that the values must be stable at.
        friction_damping: total tangential damping [N·s/m] at ``impratio`` 1; None: as the normal damping, MuJoCo's own
            way. A held object creeps at f_t / (friction_damping · impratio).

    All but ``timestep`` broadcast, so that one call serves every simulation of a ``mujoco.Batch``.

    Raises:
        ValueError: a value out of range, or not stable at this time step; says which, and what would be.
    """
    k, c, inverse, points, d = _law_inputs(compliance, inverse_weight, contact_points, impedance)
    h = float(_numbers("timestep [s]", timestep, lambda x: (x > 0) & np.isfinite(x), "positive and finite"))
    virtual_mass = points * d / ((1.0 - d) * inverse)
    _require_stable(k, c, virtual_mass, d, h, "stiffness and damping")
    solref = np.stack([-k, -c], axis=-1) * ((1.0 - d) * inverse / points)[..., None]
    friction = np.zeros_like(solref)
    if friction_damping is not None:
        tangential = _numbers(
            "friction_damping [N·s/m]", friction_damping, lambda x: (x > 0) & np.isfinite(x), "positive"
        )
        tangential, *_ = _broadcast(friction_damping=tangential, compliance=k)
        _require_stable(np.zeros_like(k), tangential, virtual_mass, d, h, "friction_damping")
        friction[..., 1] = -tangential * (1.0 - d) * inverse / points
    solimp = np.stack([d, d, *(np.full_like(d, x) for x in _SOLIMP_TAIL)], axis=-1)
    return ContactParameters(solref, solimp, friction, virtual_mass)


def least_impedance(
    compliance: Compliance, inverse_weight: ArrayLike, *, contact_points: ArrayLike, timestep: float
) -> Array:
    """Smallest impedance, so smallest virtual mass, that :func:`contact_parameters` accepts, (...,)."""
    half = 0.5  # any impedance will do: the number scales as (1 - d)/d, which is 1 here
    number = stability_number(
        compliance, inverse_weight, contact_points=contact_points, impedance=half, timestep=timestep
    )
    return np.clip(number / (number + ACCEPTED_STABILITY_NUMBER) * (1 + 1e-12), *IMPEDANCE_RANGE)


def virtual_mass_bound(
    finger_mass: ArrayLike, object_mass: ArrayLike, joint_damping: ArrayLike, timestep: ArrayLike
) -> Array:
    """Virtual mass [kg] up to which a grasp by two damped fingers is stable even without contact damping, (...,).

    ``implicitfast`` divides a finger's acceleration by (m + h D)/m after the solver has found the contact force for
    the undivided one. The virtual mass then pushes the object with M h D/m times the finger's acceleration, which feeds
    energy into an underdamped contact. With two fingers on one object the contact's own damping is not needed while

        M <= m m_object / (2 h D)

    (the modal damping of a finger against its half of the object stays positive; checked against the eigenvalues of the
    discrete-time system for 10^4 random grippers). Above it a well damped contact is still fine: the nominal grasp, 100
    N·s/m, is, up to d = 0.8; at 1 N·s/m it is not.

    Args:
        finger_mass: m [kg], of each finger.
        object_mass: [kg].
        joint_damping: D [N·s/m], joint damping plus the servo's velocity gain.
        timestep: h [s].
    """
    m, mo, damping, h = (np.asarray(x, float) for x in (finger_mass, object_mass, joint_damping, timestep))
    return np.asarray(m * mo / (2.0 * h * damping))


def set_pair_compliance(
    model: mujoco.MjModel,
    pair: str | int,
    compliance: Compliance,
    *,
    impedance: float = DEFAULT_IMPEDANCE,
    contact_points: int | None = None,
    friction_damping: float | None = None,
) -> ContactParameters:
    """Give an explicit ``<contact><pair>`` of a compiled model a total stiffness and damping, in place.

    Args:
        model: compiled; its ``opt.timestep`` is the step that the values are checked against.
        pair: name or id.
        compliance: totals over the contact (scalars).
        impedance: d in (0, 1).
        contact_points: counted by :func:`pair_contact_points` at the model's ``qpos0`` if None.
        friction_damping: see :func:`contact_parameters`.

    Returns:
        What was written, with the virtual mass.

    Raises:
        ValueError: an unknown pair, an option that breaks the law (``diagexact``, ``override``, the integrator
            ``discrete``), or whatever the functions above refuse. The model is unchanged then.
    """
    index = pair_index(model, pair)
    _require_options(model, friction_damping)
    geoms = int(model.pair_geom1[index]), int(model.pair_geom2[index])
    points = pair_contact_points(model, index) if contact_points is None else contact_points
    parameters = contact_parameters(
        compliance,
        inverse_weight(model, *geoms),
        contact_points=points,
        impedance=impedance,
        timestep=model.opt.timestep,
        friction_damping=friction_damping,
    )
    if parameters.virtual_mass.shape:
        raise ValueError("one model takes one stiffness and one damping: for a batch, use contact_parameters")
    model.pair_solref[index] = parameters.solref
    model.pair_solimp[index] = parameters.solimp
    model.pair_solreffriction[index] = parameters.solref_friction
    return parameters


def _require_options(model: mujoco.MjModel, friction_damping: float | None) -> None:
    """Refuse model options under which the contact law of this module does not hold."""
    if model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE:
        raise ValueError("option flag override replaces every contact's solref: disable it")
    if model.opt.enableflags & getattr(mujoco.mjtEnableBit, "mjENBL_DIAGEXACT", 0):
        raise ValueError("option flag diagexact makes the stiffness depend on the pose: disable it")
    if model.opt.integrator == getattr(mujoco.mjtIntegrator, "mjINT_DISCRETE", -1):
        raise ValueError("integrator 'discrete' changes stiffness and damping with the time step: use implicitfast")
    if friction_damping is not None and model.opt.cone != mujoco.mjtCone.mjCONE_ELLIPTIC:
        raise ValueError("friction_damping needs elliptic friction cones: set option cone='elliptic' or leave it out")


def _require_stable(k: Array, c: Array, mass: Array, d: Array, h: float, what: str) -> None:
    """Raise unless (h c + h² k/2)/M is accepted everywhere; names the worst and what would do instead."""
    number = (h * c + h**2 * k / 2.0) / mass
    if np.all(number <= ACCEPTED_STABILITY_NUMBER * (1 + 1e-9)):
        return
    worst = np.unravel_index(np.argmax(number), number.shape)
    at = f" (simulation {', '.join(map(str, worst))})" if worst else ""
    kw, cw, mw = k[worst], c[worst], mass[worst]
    budget = ACCEPTED_STABILITY_NUMBER * mw
    largest_step = budget / cw if kw == 0 else (np.sqrt(cw**2 + 2 * kw * budget) - cw) / kw
    largest_damping = (budget - h**2 * kw / 2) / h
    weight = number[worst] * d[worst] / (1 - d[worst])
    least_d = weight / (weight + ACCEPTED_STABILITY_NUMBER)
    culprit = f"damping {cw:g} N·s/m" if h * cw >= h**2 * kw / 2 else f"stiffness {kw:g} N/m"
    damping_hint = f", damping <= {_floor3(largest_damping):g} N·s/m" if largest_damping > 0 else ""
    raise ValueError(
        f"{what} not stable at a time step of {h:g} s{at}: {culprit} gives {number[worst]:.2f}, at most "
        f"{ACCEPTED_STABILITY_NUMBER:g} is fine; use a time step <= {_floor3(largest_step):g} s, "
        f"impedance >= {_ceil3(least_d):g}{damping_hint}"
    )


def _floor3(x: float) -> float:
    """x rounded down to three digits, so that a value given as acceptable is acceptable."""
    scale = 10.0 ** (2 - np.floor(np.log10(x)))
    return float(np.floor(x * scale) / scale)


def _ceil3(x: float) -> float:
    return float(np.ceil(x * 1e3) / 1e3) if x < 0.999 else float(x)


def _law_inputs(compliance: Compliance, inverse: ArrayLike, points: ArrayLike, impedance: ArrayLike) -> list[Array]:
    """Stiffness, damping, Â, n, d: validated and broadcast."""
    low, high = IMPEDANCE_RANGE
    return _broadcast(
        stiffness=_numbers("stiffness [N/m]", compliance.stiffness, np.isfinite, "finite (a contact cannot be rigid)"),
        damping=np.asarray(compliance.damping, float),
        inverse_weight=_numbers("inverse_weight [1/kg]", inverse, lambda x: (x > 0) & np.isfinite(x), "positive"),
        contact_points=_numbers(
            "contact_points", points, lambda x: (x >= 1) & (x == np.round(x)), "a whole number >= 1"
        ),
        impedance=_numbers("impedance", impedance, lambda x: (x >= low) & (x <= high), f"in [{low}, {high}]"),
    )
