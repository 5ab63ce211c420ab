"""What the user says, as data."""
