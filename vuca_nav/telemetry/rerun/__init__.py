"""Recording for the Rerun viewer."""
