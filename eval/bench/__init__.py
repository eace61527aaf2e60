"""Speed against named references."""
