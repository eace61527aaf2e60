"""Proximal policy optimisation for all trainings: the learner, its workers, the training loop and its directory."""
