"""The navigation stack: mapping, exploration, planning and local control. Knows nothing of any simulator."""
