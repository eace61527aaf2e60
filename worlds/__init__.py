"""Worlds: scenes of extruded shapes and moving obstacles, generated from a seed or read from a file."""
