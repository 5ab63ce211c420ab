"""Runs that are kept on disk while they go on, so that the same call continues them after it was killed."""
