"""From a scene to the equations that solvers see, a System.

base, dae            the System interface; equations that a user gives as functions
model                nodes, laws in groups, trees of recursive joints, beams; the numbering of unknowns
motion               masses, forces, constraints, accelerations and reactions at any state
changes, positions, nearest, start   consistent positions and velocities, typical sizes of the unknowns
redundancy           redundant constraint rows, which rows are integrated (dependent_rows, many_rows)
undetermined         motions without inertia
assembled            residual, Jacobian and right-hand side of a model in a form
prepare, sampling    a checked scene with its start; controllers that are called at instants
scene_system, without_multipliers   the Systems of a prepared scene

Each imports only from those above it in this list.

One System belongs to one thread at a time: evaluations of it share one array, and a run in a second thread is refused
(`threads.Owner`). `simulate` makes its own systems, so runs of one scene in several threads are independent. A System is
complete when it is made. Nothing is set on it afterwards: a part of a run that starts elsewhere is a System of its own
(`system.starting(t, y, yp)`) that shares the tables.

The words of models and equations:

node: what carries unknowns: a body, a node of a beam, the coordinate of a joint; positions q, velocities u
instance, group: one law between its nodes, with its numbers; all instances of equal law, structure and kinds of nodes,
    evaluated by one kernel
tree: recursive joints and welds from a root outwards; one program for all of its bodies, or kernels of single joints in the
    order of the bodies
carried, moved: a body or node whose position follows from joint coordinates, so that it has no unknowns of its own; *loaded*
    where a law outside its tree acts on it
sharing: beam nodes that take the displacement or rotation of another node, or are fixed
workspace, slot: one row of all numbers that kernels read (y, y', motion of loaded nodes, prescribed values, constants, a zero);
    a slot is a column of it
rows in force: the independent constraint rows that are integrated; `with_all_rows` is the mechanics with the redundant ones too
Prepared: a checked model with its rank, its start and its scales
Assembly, System: the equations of a model in a form; with a start and scales they are a System, all that a solver sees: F(t, y,
    y') = 0 with its Jacobian, y' = f(t, y) where there is one, breaks, contacts and switches
scale, characteristic time: typical size of an unknown, to which tolerances are relative; shortest time of the motion at the
    start
"""
