"""What a run knows: states, sensors, energy, reactions, accuracy, storage."""
