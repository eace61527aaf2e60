"""Statistics, comparisons and pictures of evaluated episodes."""
