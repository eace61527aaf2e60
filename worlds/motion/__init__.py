"""Motion of the moving obstacles."""
