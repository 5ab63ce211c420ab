"""Consistent start: positions that close the loops, velocities, accelerations and reactions."""
