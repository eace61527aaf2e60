"""Analysis of the gate of a fused policy: which expert leads in which situation, and what it is worth there."""
