"""Frames, variation and the Law contract: the statement of a law and everything derived from it.

The words of scenes and derivations:

statement: a call on a scene (`s.revolute(...)`), kept as plain data; of a law: the expressions it is stated by
law: one class with one symbolic statement: a joint (its motion, or rows that vanish), a coupling (rows between coordinates of
    joints), a force (energy, dissipation function or wrench), an element (kinetic energy of a body, strains of a beam)
part: a piece of a law that can be exchanged: the normal law and the friction law of a contact
frame, side: what a law sees of a body: a point, three axes and their velocities, as symbols; the sides are `k` and `l`, or as
    many as the law names, `b` for an element, `c`, `c2`, ... for joint coordinates that are unknowns
structure: what distinguishes two statements of one law apart from numbers: options, absent parameters, parameters that depend
    on time
coordinate: an angle, displacement or free rotation that a joint leaves free, 0 as drawn; *kept* where it is an unknown of its
    own (classical and recursive joints, couplings, limits of angles)
motion: the chain of elementary motions, along and about axes, by which a joint takes the axes of k to those of l
    (`symbolic/motion.py`); classical rows, recursive links, starts and reports follow from it
tie: a row that vanishes where a coordinate has a value: it prescribes the coordinate, or ties it to the bodies where it is kept
row: one scalar constraint, by its name `joint.row`; its force up to a scaling is its multiplier. *Of velocities*: it begins one
    derivative later than one of positions, and restricts how bodies move, not where they are
output: an expression that a law adds to the equations: its part of an equation of motion, a row, the rate of a row, the rate of
    a state
feed, reading: what a load reads of other places: a parameter that is a name for an expression of sensors, stated on frames that
    are added to the law for it
instant: when a sampled controller is called; its outputs are states without a rate
target: the name of the place an input or output belongs to: `("u", side, i)` equation of motion i of a node, `("q", side, i)`
    its kinematic equation, `("g", row)` a constraint, `("s", j)` an internal state
plan, kernel: the outputs of a derived law sorted into constant, linear and nonlinear; a kernel is the compiled function of one
    such sort, for many points at once
switch: an argument at which a law changes (`Piecewise`) or within whose width it acts and nowhere else (`exp`, `tanh`, negative
    powers)
"""
