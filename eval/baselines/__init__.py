"""Methods that are not the project's own, to compare with."""
