"""The contract of laws: states, variants and checks behind `mb.selftest`."""
