"""What a run returns: sensors, energy, accuracy, pictures, storage."""
