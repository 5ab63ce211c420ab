"""From a scene and an accuracy to a run with its error and its warnings; `job` lists the modules in order.

break, timeline: an instant at which an input of time or a derivative of it jumps: a step ends there; the breaks of a run with
    the longest steps between them
guards: gap, rate of the gap and duration of an impact, for every contact
tolerance, accuracy: what a solver needs (error of a step); what the user asks for (error over the whole run)
companion: a run at a larger tolerance: its distance from the run estimates the error
defect: residual of the interpolated solution between the points at which the solver evaluated the equations
"""
