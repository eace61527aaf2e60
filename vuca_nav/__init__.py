"""The navigation stack: mapping, exploration, planning and local control. It depends on no simulator."""
