"""Methods of the user's own: ``--method module:build``, a factory in the user's own Python."""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from vuca_nav.errors import BadArgument
from vuca_nav.mapping.slam import SlamConfig
from vuca_nav.navigator import Navigator, NavigatorConfig
from vuca_nav.policy.base import LocalPolicy
from vuca_nav.stack import Stack
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import BodySpec, LidarSpec
from vuca_nav.user_code import Found, Wanted, load_user_code, told


class Request(NamedTuple):
    """What a stack is built for."""

    body: BodySpec
    """The body that is driven."""
    lidar: LidarSpec
    """The body's lidar."""
    localisation: Literal["slam", "odometry"] = "slam"
    """"odometry" where the odometry is the true pose (``--without A``)."""
    telemetry: Telemetry = Telemetry()
    """Receives what the stages report."""


@dataclass(frozen=True, slots=True)
class UserMethod:
    """A factory by name: ``my_planner:build`` is the function ``build`` of the module ``my_planner``.

    The factory takes a ``Request`` and returns a ``Navigator``, another ``Stack``, or a ``LocalPolicy``, which is then
    driven like ``dwa-dh``'s. A module that Python does not find otherwise is looked for in the working directory.
    """

    name: str

    def row(self) -> dict[str, Any]:
        """The configuration as JSON holds it, with the SHA-256 of the module's source.

        Raises:
            BadArgument: The module cannot be loaded.
        """
        return {"module": self.name, "source_sha256": self._load().digest}

    def build(self, request: Request) -> Stack:
        """Build the stack.

        Raises:
            BadArgument: The module cannot be loaded, the factory raises an exception, or it returns something else.
        """
        factory = self._load().thing
        try:
            built = factory(request)
        except Exception as error:  # whatever the user's code raises is the user's to mend
            raise BadArgument(f"--method {self.name}: {told(error)}") from error
        if isinstance(built, LocalPolicy):
            slam = SlamConfig(localisation=request.localisation)
            return Navigator(request.body, request.lidar, built, NavigatorConfig(slam=slam), request.telemetry)
        if not isinstance(built, Stack):
            raise BadArgument(
                f"--method {self.name}: it returned {type(built).__name__}; a Navigator or a LocalPolicy would be right"
            )
        return built

    def _load(self) -> Found:
        wanted = Wanted(f"--method {self.name}", "a method of your own", "my_planner:build", "a function of a Request")
        return load_user_code(self.name, wanted)
