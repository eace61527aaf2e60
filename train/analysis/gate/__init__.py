"""Analysis of the gate of a fused policy: the expert that leads in each situation, and its worth there."""
