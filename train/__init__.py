"""Training: all code that needs torch. No code that runs a mission imports it."""
