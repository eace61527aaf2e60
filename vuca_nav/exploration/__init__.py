"""Exploration (0.2 Hz, 1 Hz while V^h has a say, and on triggers): frontiers scored by goal and safety.

Source: Zhang et al., Section III-C.
"""
