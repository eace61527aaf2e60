"""Generators of scenes, each from a seed; ``training`` has the worlds ``static`` and ``dynamic``."""
