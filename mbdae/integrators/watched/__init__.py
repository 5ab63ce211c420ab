"""What a step must not step over: contacts, and laws that switch or act within a short width."""
