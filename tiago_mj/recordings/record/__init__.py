"""Recording: environments and plain models logged as a real robot would be."""

from tiago_mj.recordings.motions.play import Motion, random_motion, read_motion
from tiago_mj.recordings.record.environment import Plan, make, record
from tiago_mj.recordings.record.plain import ModelPlan, record_model

__all__ = ["ModelPlan", "Motion", "Plan", "make", "random_motion", "read_motion", "record", "record_model"]
