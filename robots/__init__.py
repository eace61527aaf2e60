"""Bodies in MuJoCo, their sensors, and the simulation of a body in a world."""
