"""SLAM over recorded logs: readers, the run, its results."""
