"""Scenes on paper: the solution of their rows, and mechanisms over one coordinate."""
