"""later: refused: error nan x accuracy; SceneError: 1 problem in the scene: - start: that run has 7 positions and 6 velocities, this scene 3 and 3; continue it with the same bodies and joint models (prepare.py:118)"""
# ruff: noqa: E501, F401

from math import inf

from strangers.story import Along, Feed, Input, Made, Said, Sampled, Story

CHECK = 'later'
STORY = Story('tree', (
    Said('rigid_body', {'name': 'b1', 'mass': 1.0, 'inertia': 0.021833, 'at': (0.25, 0.0)}),
    Said('fixed_orientation', {'name': 'J1', 'k': 'ground', 'l': 'b1', 'at': (0.0, 0.0)}),
), t_end=0.5, accuracy=1e-05, gravity=(0.0, -9.81, 0.0), space='auto', model='', options={'form': "'ggl'"})
