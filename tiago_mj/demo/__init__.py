"""The demonstration: a grasp, the real force curve, a real arm recording, one page."""
