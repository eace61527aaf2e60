"""Training of the navigation policy: rewards, networks, two stages of PPO, and what they are worth."""
