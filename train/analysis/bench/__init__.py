"""Speed of the arena and of the learner, as ratios to named references."""
