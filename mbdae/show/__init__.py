"""Pictures of results: plots, drawings, animations."""
