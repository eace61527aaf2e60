"""The gate of a fused policy at work: which expert leads in which situation, and what it is worth there."""
