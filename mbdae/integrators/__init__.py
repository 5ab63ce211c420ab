"""Solvers: one file per method; all use the same step loop.

A run that is kept in a folder (`integrators/stored_runs.py`, `record.py`) is a list of stretches, each one call of
`Solver.integrate`. A solver that calls `loop.goes_on(method)` before its first step and `loop.keep(method)` between steps goes
on from any of them: `snapshot` reads its state off its objects, and what needs more than that has `snapshot` and `go_back` (LU
factors). All others begin anew every so many steps. What a System remembers beside y is told by `memory` and taken by
`remember`.
"""
