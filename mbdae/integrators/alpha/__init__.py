"""Generalised-alpha, with HHT and Newmark among them."""
