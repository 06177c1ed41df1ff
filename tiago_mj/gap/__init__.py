"""From recordings of a real robot to the effect that the simulator lacks."""
