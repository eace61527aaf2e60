"""Exploration (0.2 Hz and on triggers): frontiers scored by the goal and safety heuristics (Section III-C)."""
