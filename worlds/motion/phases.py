"""What a scene leaves open of its movers, drawn from the episode's seed."""

import math
from dataclasses import replace

from vuca_nav.errors import BadWorld
from worlds.motion.keyframes import place_of
from worlds.scenes.parts.generation import stream
from worlds.scenes.parts.population import LARGEST_FOOTPRINT
from worlds.world import Keyframes, Mover, UserMotion, World

TRIES = 1000
"""Number of phases that are tried, until no mover begins where the robot does."""
GAP = 0.1
"""Least distance between the robot, whatever its body, and a mover when the episode begins [m]."""


def drawn(world: World, seed: int) -> World:
    """The world with the phases that its keyframes leave open, and the seeds of the user's own motions.

    All open phases are one reading of a clock that all share, so that movers that keep time with each other still do.

    Args:
        world: A world that was brought in.
        seed: Seed of the episode.

    Raises:
        BadWorld: Some mover is where the robot starts whatever the phase.
    """
    movers = tuple(
        replace(m, motion=replace(m.motion, seed=seed)) if isinstance(m.motion, UserMotion) else m for m in world.movers
    )
    open_ = [m.motion for m in movers if isinstance(m.motion, Keyframes) and m.motion.phase is None]
    if not open_:
        return replace(world, movers=movers)
    longest = max(motion.period or motion.times[-1] - motion.times[0] for motion in open_)
    rng = stream("phase", seed)
    for _ in range(TRIES):
        clock = float(rng.uniform(0.0, longest))
        now = tuple(_at(mover, clock) for mover in movers)
        if all(_is_apart(mover, world) for mover in now if isinstance(mover.motion, Keyframes)):
            return replace(world, movers=now)
    raise BadWorld(f"{world.name}: start: a mover is there at any time; another start would be right")


def _at(mover: Mover, clock: float) -> Mover:
    """The mover as it is at a reading of its clock, if its phase is open."""
    motion = mover.motion
    if not isinstance(motion, Keyframes) or motion.phase is not None:
        return mover
    motion = replace(motion, phase=motion.times[0] + clock)
    return replace(mover, motion=motion, start=place_of(motion)[0])


def _is_apart(mover: Mover, world: World) -> bool:
    assert isinstance(mover.motion, Keyframes)
    place, is_there = place_of(mover.motion)
    return not is_there or math.dist(place[:2], world.start[:2]) >= mover.radius + LARGEST_FOOTPRINT + GAP
