"""Training a quadruped's gait: PPO over batched MuJoCo."""
