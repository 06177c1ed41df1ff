"""Diagnosis of recordings that hold motion and effort but no commands: inverse dynamics along what was measured."""

from tiago_mj.gap.torque.diagnose import diagnose_inverse

__all__ = ["diagnose_inverse"]
