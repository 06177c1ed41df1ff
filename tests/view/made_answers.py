"""A diagnosis that names friction in a gripper's fingers."""

from tiago_mj.gap.result import Diagnosis, Explanation, Named, Place, Shrink, Value, Verdict

LEFT = "position.gripper_left_finger_joint"
FRICTION = Named("coulomb_friction", "all", {"force": Value(2.5, 2.3, 2.7, "N")})


def answer(**changes):
    """A diagnosis that names the friction."""
    best = Explanation((FRICTION,), 0.9, 1.0)
    given = {
        "verdict": Verdict("effect", best.effects, best.probability, (best,)),
        "where": (Place(LEFT, "free motion", "bias", 600.0, 500.0, 700.0, 1.0),),
        "stage": "transmission",
        "shrink": Shrink(None, None, 1.0, None, None, None),
        "ranking": (best,),
        "findings": (),
        "next_motion": None,
        "splits": {"train": ("pi-000",), "validation": (), "test": ("pi-001",)},
        "robot": "GripperTactile-v0",
        "complete": True,
        "seed": 0,
        "version": "0",
        "seconds": 1.0,
    }
    return Diagnosis(**given).with_verdict(**changes)
