"""This package's environments and steppers: the ``calibration.yaml`` that ``effects=`` takes; nothing is left out."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

from tiago_mj.export.drives import Numbers
from tiago_mj.export.holding import NOWHERE, QUANTITIES, exact
from tiago_mj.export.targets import gymnasium_simulators
from tiago_mj.export.targets.target import Randomisation, Target

HOLDS: Final = MappingProxyType(
    dict.fromkeys(
        [*QUANTITIES.values(), *NOWHERE], exact('`effects="calibration.yaml"`, simulated as it was diagnosed')
    )
)


def write(_: Numbers) -> dict[str, str]:
    """Nothing beside the calibration, which is copied as it is."""
    return {}


TARGET: Final = Target(
    "gymnasium",
    "of this package",
    HOLDS,
    write,
    None,
    (),
    "tried in the tests of this package",
    Randomisation(
        dict.fromkeys(HOLDS, gymnasium_simulators.HELD), (gymnasium_simulators.MODULE, gymnasium_simulators.FILE), None
    ),
)
