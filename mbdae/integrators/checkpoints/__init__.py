"""Runs that are stored on disk while they are made, so that the same call continues them after its process was killed."""
