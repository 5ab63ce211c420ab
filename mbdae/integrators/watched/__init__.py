"""Contacts, and laws that switch or vary within a narrow range: steps are shortened so that none passes over one of them."""
