"""Measurements of trained policies, of bodies and of the training itself, in the arena and in MuJoCo."""
