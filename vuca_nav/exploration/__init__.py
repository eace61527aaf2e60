"""Exploration (0.2 Hz, with V^h 1 Hz, and on triggers): frontiers scored by goal and safety.

Source: Zhang et al., Section III-C.
"""
