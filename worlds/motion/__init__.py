"""How moving obstacles move."""
