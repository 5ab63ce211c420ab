"""The scene as the user states it: plain data, nothing derived."""
