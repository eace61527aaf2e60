"""Speed against named references."""

from worlds.simulator import import_simulator

import_simulator()
