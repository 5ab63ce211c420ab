"""Reports of laws and scenes, derived from the same objects that are integrated."""
