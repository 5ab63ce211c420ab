"""run: not judged: accelerations were lost after a trial step of the reference that went too far"""
# ruff: noqa: E501, F401

from math import inf

from strangers.story import Along, Feed, Input, Made, Said, Sampled, Story

CHECK = 'run'
STORY = Story('beam', (
    Said('beam', {'name': 'beam', 'points': ((0.0, 0.0, 0.0), (0.8, 0.6, 0.0)), 'section': Made(word='Section', args={'EA': 2000.0, 'GA2': 800.0, 'GA3': 800.0, 'GJ': 2.0, 'EI2': 3.0, 'EI3': 1.0, 'mass_per_length': 1.0, 'rotary_inertia': 0.01, 'damping': 0.02}), 'elements': 3, 'order': 1, 'axis2': (-0.6, 0.8, 0.0)}),
    Said('rigid_body', {'name': 'tip', 'mass': 0.3, 'inertia': (0.01, 0.02, 0.03), 'at': (0.8, 0.6, 0.0)}),
    Said('weld', {'name': 'W', 'k': 'beam', 'l': 'tip', 'at': (0.8, 0.6, 0.0)}),
    Said('line_load', {'name': 'q', 'beam': 'beam', 'per_length': Along(value=Input(kind='table periodic', said="mb.table([0.0, 0.075, 0.225], [0.0, 0.9, 0.0], outside='periodic')", pieces=((-inf, '0'), (-0.225, '0.0 + 12.0 * (t - -0.225)'), (-0.15, '0.9 + -6.0 * (t - -0.15)'), (0.0, '0.0 + 12.0 * (t - 0.0)'), (0.075, '0.9 + -6.0 * (t - 0.075)'), (0.225, '0.0 + 12.0 * (t - 0.225)'), (0.3, '0.9 + -6.0*(t - 0.3)'), (0.45, '0.0 + 12.0 * (t - 0.45)'), (0.525, '0.9 + -6*(t - 0.525)')), fine=(), scale=0.6, pace=1.0, delay=0.0), direction=(0.0, -0.6, 0.8))}),
), t_end=0.5, accuracy=0.0001, gravity=(0.0, 0.0, -9.81), space='spatial', model='', options={})
