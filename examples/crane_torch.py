r"""The path of crane_scipy.py by gradient descent in torch: the scene is one operation among those of torch.

    loss = 100 (theta(T)^2 + theta'(T)^2 / s^-2),    d loss / d (a, b) = pullback of the run by d loss / d (theta, theta')

Needs torch (pip install torch). Expected are the numbers that crane_scipy.py finds by its own equation.

Run it:  mbdae run examples/crane_torch.py --out out
"""

import crane_scipy as crane
import numpy as np

t_end, measure = crane.t_end, crane.measure
scene, picture, number = crane.scene, crane.picture, crane.number


def run(steps=30):
    """The run with the numbers that make the loss least."""
    import torch

    f = crane.swing()

    class Left(torch.autograd.Function):
        """Angle (rad) and rate (rad/s) at the end, by the two numbers (m)."""

        @staticmethod
        def forward(context, p):
            context.save_for_backward(p)
            return torch.as_tensor(f(p.detach().numpy()))

        @staticmethod
        def backward(context, weights):
            return torch.as_tensor(f.pullback(weights.numpy(), context.saved_tensors[0].numpy()))

    p = torch.zeros(2, dtype=torch.float64, requires_grad=True)
    method = torch.optim.LBFGS([p], max_iter=steps, line_search_fn="strong_wolfe", tolerance_grad=1e-9, tolerance_change=1e-14)

    def loss():
        method.zero_grad()
        found = 100 * torch.sum(Left.apply(p) ** 2)
        found.backward()
        return found

    method.step(loss)
    return scene(*p.detach().numpy()).simulate(t_end, outputs=np.linspace(0, t_end, 201))


if __name__ == "__main__":
    print(run().prepared.model.scene.numbers, crane.expected())
