"""run: silent: error 10.4 x accuracy; reactions, asked 1e-03; DOP853(rtol=7.912755700467267e-07, atol=None)"""
# ruff: noqa: E501, F401

from math import inf

from strangers.story import Along, Feed, Input, Made, Said, Sampled, Story

CHECK = 'run'
STORY = Story('contact', (
    Said('link', {'name': 'b1', 'points': ((0.0, 0.0), (0.6, 0.8)), 'mass': 1.0}),
    Said('link', {'name': 'b2', 'points': ((0.6, 0.8), (1.4, 0.2)), 'mass': 0.5}),
    Said('revolute', {'name': 'A', 'k': 'ground', 'l': 'b1', 'at': (0.0, 0.0), 'rate0': 2.0}),
    Said('revolute', {'name': 'J', 'k': 'b1', 'l': 'b2', 'at': (0.6, 0.8), 'model': Made(word='Clearance', args={'outer': 0.051000000000000004, 'inner': 0.05, 'normal': Made(word='Hertz', args={'stiffness': 10000000.0, 'damping': 0.3}), 'friction': None})}),
), t_end=0.5, accuracy=0.001, gravity=(0.0, -9.81, 0.0), space='auto', model='', options={'solver': "'dop853'", 'form': "'index1'"})
