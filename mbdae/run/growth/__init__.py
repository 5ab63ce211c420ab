"""Small disturbances that grow along a run: steps that follow them, and how much they grow."""
