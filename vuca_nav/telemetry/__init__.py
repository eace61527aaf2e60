"""Telemetry of a run: the interface, and the recorder for Rerun beneath it."""
