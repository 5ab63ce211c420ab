"""Events of a run: conditions on sensors, and the instants at which they begin or cease to hold."""
