"""Mistakes put into the package on purpose, and which tests see them; run by `python validation/mutation`."""
