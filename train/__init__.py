"""Training: what needs torch. Nothing that runs a mission imports it."""
