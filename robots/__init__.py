"""Bodies in MuJoCo, their sensors, and the simulation of a body in a world."""

from worlds.simulator import import_simulator

import_simulator()
