"""run: silent: error 3.68 x accuracy; reactions, asked 1e-03; RadauIIA(3), ODE, spatial, 26 unknowns, dense: contacts, at whose begin its steps end; BDF gains or loses more energy there"""
# ruff: noqa: E501, F401

from math import inf

from strangers.story import Along, Feed, Input, Made, Said, Sampled, Story

CHECK = 'run'
STORY = Story('contact', (
    Said('rigid_body', {'name': 'ball1', 'mass': 1.0, 'inertia': (0.004, 0.004, 0.004), 'at': (0.0, 0.12, 0.1)}),
    Said('contact', {'name': 'C1', 'k': 'ground', 'l': 'ball1', 'shape_k': Made(word='Plane', args={'at': (0, 0, 0.1), 'normal': (0.0, 1.0, 0.0)}), 'shape_l': Made(word='Sphere', args={'at': (0.0, 0.12, 0.1), 'radius': 0.1}), 'normal': Made(word='Hertz', args={'stiffness': 10000000.0, 'damping': 0.3}), 'friction': None}),
    Said('rigid_body', {'name': 'ball2', 'mass': 1.0, 'inertia': (0.004, 0.004, 0.004), 'at': (0.3, 0.37, 0.1)}),
    Said('contact', {'name': 'C2', 'k': 'ground', 'l': 'ball2', 'shape_k': Made(word='Plane', args={'at': (0, 0, 0.1), 'normal': (0.0, 1.0, 0.0)}), 'shape_l': Made(word='Sphere', args={'at': (0.3, 0.37, 0.1), 'radius': 0.1}), 'normal': Made(word='Hertz', args={'stiffness': 10000000.0, 'damping': 0.0}), 'friction': None}),
    Said('contact', {'name': 'CC', 'k': 'ball1', 'l': 'ball2', 'shape_k': Made(word='Sphere', args={'at': (0.0, 0.12, 0.1), 'radius': 0.1}), 'shape_l': Made(word='Sphere', args={'at': (0.3, 0.37, 0.1), 'radius': 0.1}), 'normal': Made(word='Hertz', args={'stiffness': 10000000.0, 'damping': 0.0}), 'friction': None}),
    Said('force', {'name': 'F', 'body': 'ball1', 'value': Along(value=Input(kind='bump', said='sp.Piecewise((0, {t} < 0.25), (sp.sin(({t} - 0.25) * 125.66370614359161)**2, {t} < 0.275), (0, True))', pieces=((-inf, '0'), (0.25, 'sin((t - 0.25) * 125.66370614359161)**2'), (0.275, '0')), fine=(), scale=48.0, pace=1.0, delay=0.0), direction=(0.6, 0.8, 0.0))}),
), t_end=0.5, accuracy=0.001, gravity=(0.0, -9.81, 0.0), space='auto', model='', options={})
