"""What is kept on disk from one process to the next: derived and compiled laws."""
