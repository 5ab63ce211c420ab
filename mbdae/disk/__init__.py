"""Storage of derived and compiled laws on disk between processes."""
