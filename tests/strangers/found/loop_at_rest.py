"""A loop at rest without forces: reactions of round-off are no errors."""
# ruff: noqa: E501, F401

from math import inf

from strangers.story import Along, Feed, Input, Made, Said, Sampled, Story

CHECK = 'run'
STORY = Story('loop', (
    Said('rigid_body', {'name': 'b1', 'mass': 1.0, 'inertia': 0.014333, 'at': (0.0, 0.2)}),
    Said('revolute', {'name': 'J1', 'k': 'ground', 'l': 'b1', 'at': (0.0, 0.0), 'axis': (0, 0, 1)}),
    Said('link', {'name': 'b2', 'points': ((0.0, 0.4), (-0.4, 0.4)), 'mass': 3.0}),
    Said('revolute', {'name': 'J2', 'k': 'b1', 'l': 'b2', 'at': (0.0, 0.4), 'axis': (0, 0, 1)}),
    Said('rigid_body', {'name': 'b3', 'mass': 1.0, 'inertia': 0.014333, 'at': (-0.52, 0.24)}),
    Said('revolute', {'name': 'J3', 'k': 'b2', 'l': 'b3', 'at': (-0.4, 0.4), 'axis': (0, 0, 1)}),
    Said('revolute', {'name': 'close', 'k': 'ground', 'l': 'b3', 'at': (-0.64, 0.08)}),
    Said('spring', {'name': 'S0', 'k': 'ground', 'l': 'b2', 'at_k': (-0.596, -0.272), 'at_l': (-0.4, 0.4), 'stiffness': 10.0, 'damping': 0.0}),
), t_end=0.5, accuracy=1e-06, gravity=(0.0, 0.0, 0.0), space='auto', model='', options={'solver': "'dop853'", 'form': "'index1'"})
