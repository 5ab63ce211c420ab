"""Reports of scenes: an overview of the system, and its joint forces in closed form."""
