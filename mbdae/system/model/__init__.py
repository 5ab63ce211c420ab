"""What a scene requires: nodes, groups of equal laws, trees of joints, beams, and the numbering of unknowns."""
