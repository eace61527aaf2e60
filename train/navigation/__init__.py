"""Training of the navigation policy: networks, two stages of PPO, and the export of the weights."""
