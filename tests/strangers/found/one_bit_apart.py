"""run: told, inf: a sample at 3 * 0.05 s and a kink at 0.15 s left a stretch of one bit, in which no step is possible"""
# ruff: noqa: E501, F401

from math import inf

from strangers.story import Along, Feed, Input, Made, Said, Sampled, Story

CHECK = 'run'
STORY = Story('control', (
    Said('link', {'name': 'b1', 'points': ((0.0, 0.0), (1.0, 0.0)), 'mass': 1.0}),
    Said('controller', {'name': 'hold', 'f': Made(word='Holding', args={'gain': 20.0, 'rate_gain': 0.5, 'target': 0.3}), 'every': 0.05, 'reads': ('J1.angle', 'J1.rate'), 'sets': ('u',)}),
    Said('revolute', {'name': 'J1', 'k': 'ground', 'l': 'b1', 'at': (0.0, 0.0), 'axis': (0, 0, 1), 'torque': Sampled(name='u')}),
    Said('torque', {'name': 'M0', 'body': 'b1', 'value': Along(value=Input(kind='table', said='mb.table([0.0, 0.05, 0.1, 0.15, 0.3], [0.0, 1.0, 0.0, 1.0, 0.0])', pieces=((-inf, '0.0'), (0.0, '0.0 + 20.0 * (t - 0.0)'), (0.05, '1.0 + -20.0 * (t - 0.05)'), (0.1, '0.0 + 20.0 * (t - 0.1)'), (0.15, '1.0 + -6.666666666666667 * (t - 0.15)'), (0.3, '0.0')), fine=(), scale=3.0, pace=1.0, delay=0.0), direction=(0.0, 0.0, 1.0))}),
), t_end=0.5, accuracy=0.0001, gravity=(0.0, -9.81, 0.0), space='auto', model='', options={'solver': "'radau3'"})
