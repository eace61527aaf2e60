"""The shield: a filter under any local policy."""
