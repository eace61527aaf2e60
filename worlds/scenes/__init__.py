"""Generators of scenes, each from a seed."""
