"""From a scene to the equations that solvers see, a System.

base, dae            the System interface; equations that a user gives as functions
model                nodes, laws in groups, trees of recursive joints, beams; the numbering of unknowns
motion               masses, forces, constraints, accelerations and reactions at any state
start                consistent positions and velocities, typical sizes of the unknowns
rank                 redundant constraint rows, which rows are integrated, motions without inertia
assembled            residual, Jacobian and right-hand side of a model in a form
prepare              a checked scene with its start
scene_system, without_multipliers   the Systems of a prepared scene

Each imports only from those above it in this list.
"""
