"""Which constraint rows follow from others (redundant constraints), which rows are integrated, and motions without inertia."""
