r"""The path of crane_scipy.py in jax: the scene is called back, and jax.jacrev has the derivatives of what it returns.

    p <- p - J^-1 r(p),    r = (theta(T), theta'(T)),    J = dr/dp by jax.jacrev, one backward sweep of the run for each row

Needs jax (pip install jax). Expected are the numbers that crane_scipy.py finds by its own equation.

Run it:  mbdae run examples/crane_jax.py --out out
"""

import crane_scipy as crane
import numpy as np

t_end, measure = crane.t_end, crane.measure
scene, picture, number = crane.scene, crane.picture, crane.number


def run(steps=6):
    """The run with the numbers that leave nothing of the swing."""
    import jax

    f = crane.swing()

    @jax.custom_vjp
    def left(p):
        return jax.pure_callback(f, jax.ShapeDtypeStruct((2,), np.float64), p, vmap_method="sequential")

    def back(p, w):
        return (jax.pure_callback(lambda p, w: f.pullback(w, p), p, p, w, vmap_method="sequential"),)

    left.defvjp(lambda p: (left(p), p), back)
    with jax.enable_x64(True) if hasattr(jax, "enable_x64") else jax.experimental.enable_x64():
        p = jax.numpy.zeros(2)
        for _ in range(steps):
            p = p - jax.numpy.linalg.solve(jax.jacrev(left)(p), left(p))
    return scene(*np.asarray(p)).simulate(t_end, outputs=np.linspace(0, t_end, 201))


if __name__ == "__main__":
    print(run().prepared.model.scene.numbers, crane.expected())
