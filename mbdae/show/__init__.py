"""Pictures of results: plots, drawings, films."""
