"""What a diagnosis found, written for the simulators that people train in."""
