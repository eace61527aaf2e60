"""Budgets of the tests that feed damaged files to the program: seconds in the fast tests, an hour in the slow ones."""

from datetime import timedelta

from hypothesis import HealthCheck, settings

FAST = settings(
    max_examples=60,
    deadline=timedelta(seconds=20),  # nothing hangs; a loaded machine is slow
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    print_blob=True,
)
SLOW = settings(FAST, max_examples=4000)
