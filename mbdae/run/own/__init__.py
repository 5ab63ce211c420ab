"""Runs of equations of a user's own, `mb.DAE`."""
