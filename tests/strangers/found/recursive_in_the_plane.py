"""run: refused: error nan x accuracy; SceneError: 1 problem in the scene: - body 'b1' can move without any inertia: give it mass or inertia, or a joint that stops this motion (prepare.py:142)"""
# ruff: noqa: E501, F401

from math import inf

from strangers.story import Along, Feed, Input, Made, Said, Sampled, Story

CHECK = 'run'
STORY = Story('tree', (
    Said('link', {'name': 'b1', 'points': ((0.0, 0.0), (0.4, 0.3)), 'mass': 1.0}),
    Said('bushing', {'name': 'J1', 'k': 'ground', 'l': 'b1', 'at': (0.0, 0.0), 'stiffness': (200.0, 200.0, 200.0), 'damping': (0.0, 0.0, 0.0)}),
    Said('link', {'name': 'b2', 'points': ((0.0, 0.0), (0.5, 0.0)), 'mass': 1.0}),
    Said('revolute', {'name': 'J2', 'k': 'ground', 'l': 'b2', 'at': (0.0, 0.0), 'axis': (0, 0, 1)}),
    Said('link', {'name': 'b3', 'points': ((0.4, 0.3), (0.8, 0.6)), 'mass': 1.0}),
    Said('planar', {'name': 'J3', 'k': 'b1', 'l': 'b3', 'at': (0.4, 0.3), 'axis': (0, 0, 1), 'spring': {'angle': 3.0}, 'damper': {'angle': 0.1}}),
    Said('link', {'name': 'b4', 'points': ((0.5, 0.0), (0.08, 0.56)), 'mass': 1.0}),
    Said('fixed_orientation', {'name': 'J4', 'k': 'b2', 'l': 'b4', 'at': (0.5, 0.0)}),
    Said('torque', {'name': 'M0', 'body': 'b4', 'value': Along(value=Input(kind='table step', said="mb.table([0.025, 0.15, 0.155, 0.16, 0.21], [0.0, 0.5, -0.8, 0.7, 0.5], kind='step')", pieces=((-inf, '0.0'), (0.025, '0.0'), (0.15, '0.5'), (0.155, '-0.8'), (0.16, '0.7'), (0.21, '0.5')), fine=(), scale=0.3, pace=1.0, delay=0.0), direction=(0.0, 0.0, 1.0))}),
), t_end=0.5, accuracy=0.001, gravity=(0.0, -9.81, 0.0), space='auto', model='recursive', options={'verify': 'True'})
