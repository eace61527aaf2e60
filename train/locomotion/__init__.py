"""Training a quadruped's gait: PPO over batched MuJoCo."""

from worlds.simulator import import_simulator

import_simulator()
