"""Safety under everything: limits, a collision monitor on the raw scan, watchdogs, the emergency stop.

The layer takes any command and returns the one that is allowed. It knows nothing of policies, shield or planner, and
reads no clock: times are handed in.
"""
