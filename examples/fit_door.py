"""A door closer from noisy data: spring, damper and friction of a hinge from the angle that a sensor showed.

    python examples/fit_door.py          numbers with their standard deviations
"""
