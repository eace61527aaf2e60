"""Proximal policy optimisation, once for all: the learner, its workers, the training loop and its directory."""
