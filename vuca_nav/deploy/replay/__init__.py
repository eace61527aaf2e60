"""Logs of missions, read with suspicion, and the stack over them: `vuca replay`."""
