"""Training of the critic of V^h, which rates frontiers by the chance of reaching them without meeting a mover."""
