"""What a run tells about itself: the interface, and the recorder for Rerun beneath it."""
