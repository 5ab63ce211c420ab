"""Solvers: one file per method over a shared step loop."""
