"""The lanes of a factory: the strips along one direction that its corridors can lie in."""

from dataclasses import dataclass

from numpy.random import Generator

from worlds.scenes.parts.generation import uniform

HALL = 40.0
"""Side of the whole factory [m]."""
HALF = HALL / 2
MIDDLE_WALL = 0.2
"""Thickness of the walls between quarters, and of the outer ones [m]."""
LANE_WIDTH = (1.8, 2.9)
"""Range of the lanes' widths [m]; block fronts stand back a little, so that corridors are 1.8 to 3.0 m wide."""
NARROW_LANE_SHARE = 0.25
"""Share of lanes narrower than 2.2 m, which moving obstacles keep out of."""
MIN_BLOCK = 1.8
"""Smallest block between two lanes [m]."""
SETBACK = 0.2
"""Block fronts stand back from their lane by up to this: so much later an alley may begin [m]."""


@dataclass(frozen=True, slots=True)
class Lanes:
    """The lanes of one direction, as intervals of the other coordinate, in ascending order."""

    intervals: tuple[tuple[float, float], ...]
    """[m]"""
    halves: tuple[int, ...]
    """Half of the hall that each lane is in, 0 or 1."""

    def centre(self, i: int) -> float:
        """Coordinate of a lane's middle line [m]."""
        return sum(self.intervals[i]) / 2

    def width(self, i: int) -> float:
        """Width of a lane [m]."""
        return self.intervals[i][1] - self.intervals[i][0]

    def gap(self, i: int) -> tuple[float, float]:
        """Interval between this lane and the next [m]."""
        return self.intervals[i][1], self.intervals[i + 1][0]


def draw_lanes(rng: Generator) -> Lanes:
    """Draw three or four lanes a half, the first and the last of each along its walls."""
    intervals: list[tuple[float, float]] = []
    halves: list[int] = []
    for half in (0, 1):
        low = MIDDLE_WALL if half == 0 else HALF + MIDDLE_WALL / 2
        high = HALF - MIDDLE_WALL / 2 if half == 0 else HALL - MIDDLE_WALL
        while True:
            count = 3 if rng.random() < 0.2 else 4
            widths = [
                uniform(rng, LANE_WIDTH[0], 2.1)
                if rng.random() < NARROW_LANE_SHARE
                else uniform(rng, 2.4, LANE_WIDTH[1])
                for _ in range(count)
            ]
            shares = rng.uniform(0.8, 1.2, count - 1)
            blocks = shares / shares.sum() * (high - low - sum(widths))
            if blocks.min() >= MIN_BLOCK:
                break
        at = low
        for i, width in enumerate(widths):
            intervals.append((round(float(at), 3), round(float(at + width), 3)))
            at += width + (blocks[i] if i < count - 1 else 0.0)
        halves += [half] * count
    return Lanes(tuple(intervals), tuple(halves))
