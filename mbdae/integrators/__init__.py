"""Solvers: one file per method; all use the same step loop."""
