"""The native core: the loops between kernels, in C."""
