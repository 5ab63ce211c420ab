"""Robots: files read into scenes, joint-space dynamics."""
