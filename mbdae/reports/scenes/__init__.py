"""The report of a scene: its sheet, and its joint forces in closed form."""
