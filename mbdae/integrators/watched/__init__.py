"""Contacts, and laws that switch or vary within a narrow range: no step may pass over them."""
