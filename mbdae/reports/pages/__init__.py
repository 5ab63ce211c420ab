"""The pages of laws: joints, couplings, forces, bodies, lines, friction and normal laws."""
