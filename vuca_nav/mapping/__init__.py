"""Mapping (30 Hz): laser SLAM on occupancy grids (Zhang et al., Section III-C, SLAM-based mapping)."""
