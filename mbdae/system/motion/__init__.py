"""The equations of motion at any state: masses, forces, constraints, accelerations and reactions."""
