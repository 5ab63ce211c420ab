"""Reports: what a law or a scene is, derived from what is integrated."""
