"""Generalised-alpha methods, including HHT and Newmark."""
