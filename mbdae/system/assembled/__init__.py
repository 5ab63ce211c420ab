"""Residual, Jacobian and right-hand side of a whole scene, put together from the kernels of its laws."""
