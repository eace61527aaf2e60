"""Two local policies, of which one drives in narrow ways and the other elsewhere."""

from vuca_nav.perception.percept import MOVERS_NEAR, Percept
from vuca_nav.policy.base import LocalGoal, LocalPolicy
from vuca_nav.policy.dynamic_window import DynamicWindow
from vuca_nav.types import VelocityCommand


class Handover(LocalPolicy):
    """A policy that hands over to the dynamic window where the way is narrow and nothing moves nearby.

    A network hovers before gaps narrower than those of its training; the window knows the footprint to the centimetre,
    but not where movers go.

    Args:
        policy: Drives where the way is wide.
        window: Drives where it is narrow.
    """

    def __init__(self, policy: LocalPolicy, window: DynamicWindow):
        self.policy, self.window = policy, window
        self.rate = policy.rate

    def reset(self) -> None:
        """Forget the last mission."""
        self.policy.reset()
        self.window.reset()

    def command(self, percept: Percept, goal: LocalGoal | None) -> VelocityCommand:
        """The command of the one that drives here."""
        if goal is not None and goal.is_narrow and not percept.moves_within(MOVERS_NEAR):
            return self.window.command(percept, goal)
        command = self.policy.command(percept, goal)
        self.window.follow(command)
        return command
