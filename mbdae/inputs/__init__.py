"""Functions of time: their language, where they jump, how fast they vary."""
