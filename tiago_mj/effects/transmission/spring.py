"""A spring between a joint and what carries it."""

from __future__ import annotations

from typing import Final

import numpy as np

from tiago_mj.effects.declare import Array, Effect, effect
from tiago_mj.effects.fields import Usual, detail, known_to, parameter
from tiago_mj.effects.now import Now

#: Of a joint without limits, how far its spring is stretched either way where its mean stiffness is stated (slide [m],
#: hinge [rad]).
STRETCH: Final = (0.05, 1.0)
#: Where a spring is slack, and the coefficients a, b, c of its force -(a x + b x² + c x³).
Spring = tuple[float, Array]


@effect("joint_spring", stage="transmission", targets="joint")
class JointSpring(Effect):
    """A spring pulls a joint to where it is slack: a balancer, a return spring, a boot, a cable that bends.

    Its stiffness is the mean over the joint's range (where it has no limits, over 0.05 m or 1 rad to either side of
    where the spring is slack). A share of the force may grow with the cube of the stretch.

    Formula: x = position - rest; force -= factor · x · (1 - hardening + hardening · (x / range)²), the factor such that
    the mean stiffness is the stated one

    In a recording: holding still, the servo's error or effort is in proportion to the position, whatever the pose of
    the other joints; the joint swings faster.

    Typical: 0.01-0.3 of the largest effort over the range.

    On the robot: move the unpowered joint by hand and let go: where does it rest? Look at balancers, boots and cables.

    Source: chosen.

    MuJoCo: a joint's ``stiffness`` (a polynomial) and ``springref``; with a spring of the model's own their sum.
    """

    clause = "a spring of {stiffness} pulls {t} that the simulator lacks"
    form_known_to = 0.1
    #: Along a motion, where the recordings speak against the model's centres of mass and the like: cables pull by as
    #: much as a constant torque does (:class:`TorqueOffset`) over a usual stretch. Uncertain from the start, a real
    #: TX40's joints hid what is told of its shared motor.
    doubted_prior = known_to((0.02 / STRETCH[0], 0.02 / STRETCH[1]), share_of="effort")
    stiffness = parameter(("N/m", "N·m/rad"), identity=0.0, default=(100.0, 1.0), bounds=((0.0, 400.0), (0.0, 30.0)))
    #: Position at which it is slack.
    rest = detail(("m", "rad"), (-10.0, 10.0), usual=Usual(0.0, STRETCH), moment=True)
    #: Share of the force at a stretch of the joint's range that grows with the cube of the stretch. The mean stiffness
    #: stays: else a magnitude and its form could hardly be told apart, and a spring that 8000 nats speak for had a
    #: stiffness known to 40 %.
    hardening = detail("-", (0.0, 1.0), usual=Usual(0.0, 0.5), moment=True)

    def change(self, now: Now) -> None:
        model, joints = now.host.model, now.host.model.dof_jntid[now.wiring.dof]
        linear, more, slack = (now.host.field(name) for name in ("jnt_stiffness", "jnt_stiffnesspoly", "qpos_spring"))
        for k, (joint, place) in enumerate(zip(joints, now.wiring.qpos, strict=True)):
            limits = model.jnt_range[joint] if model.jnt_limited[joint] else None
            stretch = STRETCH[0 if now.wiring.targets.slides[k] else 1]
            for sim in np.flatnonzero(self.present[:, k]):
                before = np.array([linear[sim, joint], *more[sim, joint]])
                rest, cubic = float(self.rest[sim, k]), float(self.hardening[sim, k])
                low, high = (rest - stretch, rest + stretch) if limits is None else limits
                added = self.stiffness[sim, k] * polynomial(
                    rest, cubic, low, high, stretch if limits is None else high - low
                )
                slack[sim, place], (linear[sim, joint], *more[sim, joint]) = sum_of_springs(
                    (slack[sim, place], before), (rest, added)
                )


def polynomial(rest: float, cubic: float, low: float, high: float, stretch: float) -> Array:
    """Coefficients a, b, c of the force -(a x + b x² + c x³) of a spring whose mean stiffness between two positions is
    1, (3,).

    Args:
        rest: where it is slack.
        cubic: share of the force at a stretch that grows with its cube.
        low, high: the positions.
        stretch: that stretch.
    """
    linear, third = 1 - cubic, cubic / stretch**2
    mean = linear + third * ((high - rest) ** 3 - (low - rest) ** 3) / (high - low)
    return np.array([linear, 0.0, third]) / mean


def sum_of_springs(one: Spring, other: Spring) -> Spring:
    """Two springs side by side as one.

    Of several places at which the two balance it is slack in the one nearest to their middle.
    """
    if not np.any(one[1]):
        return other[0], np.asarray(other[1])
    polynomials = [
        np.polynomial.Polynomial([0.0, *coefficients])(np.polynomial.Polynomial([-slack, 1.0]))
        for slack, coefficients in (one, other)
    ]
    both = polynomials[0] + polynomials[1]
    roots = both.trim().roots()
    real = roots[np.abs(roots.imag) <= 1e-9 * (1 + np.abs(roots))].real
    middle = (one[0] + other[0]) / 2  # where two that cancel each other leave a constant force, which no spring has
    rest = float(real[np.argmin(np.abs(real - middle))]) if len(real) else middle
    return rest, np.array([both.deriv(n)(rest) / factorial for n, factorial in ((1, 1), (2, 2), (3, 6))])
