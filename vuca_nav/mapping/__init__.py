"""Mapping (30 Hz): laser SLAM on occupancy grids (Section III-C, SLAM-based mapping)."""
