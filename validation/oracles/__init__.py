"""References that share no code with the package: Pinocchio for trees, dense equations of motion for loops, DOP853 for runs."""
