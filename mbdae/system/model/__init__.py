"""The model of a scene: nodes, groups of equal laws, trees of joints, beams, and the numbering of unknowns."""
