"""The laws that mbdae ships, one per file: joints, forces, contact, friction, elements."""
