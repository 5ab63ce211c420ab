"""From a scene to a System: numbering, assembly, rank and a consistent start."""
