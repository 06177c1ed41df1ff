"""Cases without an effect: what the search finds in a library of effects that a nominal number may stand for.

They are what a change of bounds or of the step's error must not make a false name of.
"""

from __future__ import annotations

from typing import Any, Final

from benchmarks.experiments import results, search
from benchmarks.experiments.kept_cases import Kept, without_effect
from benchmarks.experiments.opened import open_case

#: Effects on all targets: those of nominal numbers, their twins, and creep.
RIVALS: Final = (
    "servo_stiffness", "torque_constant", "joint_elasticity", "servo_damping", "armature", "contact_stiffness",
    "contact_damping", "object_mass", "force_gain", "command_delay", "pad_creep", "viscous_friction", "payload",
)  # fmt: skip
#: The best of them that are kept.
KEPT: Final = 2
#: Grippers and hinges.
GRIPPERS, HINGES = 3, 12


def rivals(kept: Kept) -> dict[str, Any]:
    """The best explanations of a case that needs none."""
    opened = open_case(kept)
    found = search.compared(opened, search.searched(opened, {(name, None) for name in RIVALS}))
    fits = sorted((f for f in found.fits.values() if f.parts), key=lambda f: -f.evidence)
    rungs = {"nominal": found.nominal(), **{f"rival {k + 1}": fit for k, fit in enumerate(fits[:KEPT])}}
    return {
        "setting": f"{kept.case.setting} {kept.case.interface} {kept.case.rate:g} Hz",
        "trials": list(found.by.trials),
        "weight": [round(float(w), 4) for w in found.by.weight],
        "corrected": found.by.predict.corrected,
        "rungs": {name: search.row(fit) for name, fit in rungs.items()},
        "today": search.decided(opened, list(found.fits.values())),
    }


if __name__ == "__main__":
    results.run("without_effect", __doc__, without_effect(GRIPPERS, HINGES), rivals)
