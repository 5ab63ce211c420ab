"""A pendulum to be swung up, as an environment of gymnasium, stepped by `s.stepper`.

The torque is at most a third of the weight's moment, so that the rod has to be swung. The action is the torque over its limit;
the observation cos, sin of the angle from upright, and the rate; the reward 0 at rest upright, negative elsewhere. An episode
begins hanging, turned by up to 0.1 rad, and ends after 200 steps of 50 ms.

`swing_up` needs no learning: energy that is pumped in until it is that of the upright rod, E = m g a. It drives along the rate,
while E is too small, so that the rod comes to within 0.2 rad of upright.

Run it:  mbdae run examples/gym_pendulum.py --out out
"""

import numpy as np

import mbdae as mb

MASS, LENGTH, G, DT = 1.0, 1.0, 9.81, 0.05  # kg, m, m/s^2, s
LIMIT = MASS * G * LENGTH / 2 / 3  # N m
STEPS = 200

t_end = STEPS * DT
measure = "hinge.angle"


def scene():
    """A rod that hangs from a motor, its torque the input u."""
    s = mb.Scene("gym pendulum", gravity=(0, -G, 0))
    rod = s.link("rod", (0, 0), (0, -LENGTH), mass=MASS)
    s.signal("u", 0.0)  # N m
    s.revolute("hinge", s.ground, rod, at=(0, 0), torque="u")
    return s


def energy(angle, rate):
    """Energy over that at rest upright, J: 0 there; angle from hanging, rad."""
    return MASS * LENGTH**2 / 6 * rate**2 - MASS * G * LENGTH / 2 * (1 + np.cos(angle))


def swing_up(observation):
    """Torque over its limit that raises the energy to that of the upright rod."""
    cosine, sine, rate = observation
    missing = -energy(np.arctan2(sine, cosine) + np.pi, rate)
    return np.clip(np.array([2.0 * missing * np.sign(rate + 1e-9)]), -1, 1).astype(np.float32)


def environment():
    """The environment, a subclass of gymnasium.Env; gymnasium is imported here."""
    import gymnasium

    class Pendulum(gymnasium.Env):
        action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
        observation_space = gymnasium.spaces.Box(np.array([-1, -1, -50]), np.array([1, 1, 50]), dtype=np.float64)

        def __init__(self):
            self.step_of_scene = scene().stepper(DT)

        def reset(self, *, seed=None, options=None):
            super().reset(seed=seed)
            self.count = 0
            self.step_of_scene.reset(values={"hinge.angle": self.np_random.uniform(-0.1, 0.1)})
            return self.seen(), {}

        def step(self, action):
            s = self.step_of_scene
            s.set(u=LIMIT * float(action[0]))
            s.advance()
            self.count += 1
            angle, rate = s["hinge.angle"], s["hinge.rate"]
            reward = -(1 + np.cos(angle)) - 0.01 * rate**2 - 0.001 * float(action[0]) ** 2
            return self.seen(), float(reward), False, self.count >= STEPS, {}

        def seen(self):
            """The observation."""
            angle, rate = self.step_of_scene["hinge.angle"] + np.pi, self.step_of_scene["hinge.rate"]
            return np.array([np.cos(angle), np.sin(angle), rate])

    return Pendulum()


def nearest(step, angle0):
    """Smallest angle from upright that `swing_up` reaches within an episode, rad; step: a stepper of the scene."""
    step.reset(values={"hinge.angle": angle0})
    best = np.pi
    for _ in range(STEPS):
        angle, rate = step["hinge.angle"], step["hinge.rate"]
        best = min(best, abs((angle + 2 * np.pi) % (2 * np.pi) - np.pi))
        step.set(u=LIMIT * float(swing_up((np.cos(angle + np.pi), np.sin(angle + np.pi), rate))[0]))
        step.advance()
    return best


if __name__ == "__main__":
    print(f"nearest to upright: {nearest(scene().stepper(DT), 0.1):.3f} rad")
