"""Repair of inertias that no rigid body can have.

A body's principal moments A <= B <= C are positive and A + B >= C. CAD exports and hand-written URDFs break this. The
usual mend, MuJoCo's ``balanceinertia``, replaces the tensor by its isotropic mean: a long finger then resists turning
about its long axis several times too much. Here the axes stay, small moments are lifted to a floor and the largest is
clamped to A + B.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Floor of a principal moment: a radius of gyration of 1 mm. Far below that of any part of a robot, far above rounding.
SMALLEST_RADIUS_OF_GYRATION = 1e-3  # m

#: A + B >= C is met with this relative margin, so that rounding in a file does not break it again.
MARGIN = 1e-9


@dataclass(frozen=True)
class InertiaRepair:
    """What was changed: principal moments [kg m2], ascending, before and after."""

    link: str
    before: tuple[float, ...]
    after: tuple[float, ...]

    def __str__(self) -> str:
        before, after = (" ".join(f"{value:.4g}" for value in moments) for moments in (self.before, self.after))
        return f"link {self.link}: principal moments {before} -> {after} kg m2"


def is_valid(inertia: Array) -> bool:
    """Whether a rigid body can have this inertia (3, 3): positive moments, the largest within the sum of the others."""
    a, b, c = np.linalg.eigvalsh(inertia)
    return bool(a > 0 and a + b >= c * (1 - 1e-12))


def repair(link: str, mass: float, inertia: Array) -> tuple[Array, InertiaRepair | None]:
    """The nearest valid inertia with the same principal axes, and what was changed (None: nothing).

    Args:
        link: name of the link, for the report.
        mass: of the link [kg], above zero.
        inertia: about the centre of mass [kg m2], (3, 3), symmetric.
    """
    if is_valid(inertia):
        return inertia, None
    moments, axes = np.linalg.eigh(inertia)
    floor = mass * SMALLEST_RADIUS_OF_GYRATION**2
    mended = np.where(moments <= 0, floor, moments)
    order = np.argsort(mended)
    a, b, c = mended[order]
    mended[order[2]] = min(c, (a + b) * (1 - MARGIN))
    repaired = axes @ np.diag(mended) @ axes.T
    repaired = (repaired + repaired.T) / 2
    return repaired, InertiaRepair(link, tuple(moments.tolist()), tuple(np.sort(mended).tolist()))
