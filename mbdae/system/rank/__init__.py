"""Which constraint rows follow from others, and the magnitudes that decide what is small."""
