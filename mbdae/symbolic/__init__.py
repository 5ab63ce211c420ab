"""Frames, variation and the Law contract: the statement of a law and everything derived from it."""
