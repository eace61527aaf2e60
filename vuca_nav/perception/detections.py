"""Detections: objects of a person's size in one scan, as segments in front of a background or pairs of legs."""

import math

from vuca_nav.kernel_cache import njit

MAX_WIDTH = 1.2
"""Width of a detection: the widest moving obstacle is 0.9 m, and a wall's piece is wider [m]."""
_JUMP, _JUMP_SLOPE = 0.15, 0.06
"""Ranges of neighbouring beams on one surface differ by at most this, and this share of the range [m]."""
_DEPTH = 0.7
"""Distance of an object's centre behind its visible surface, in half widths: 0.79 for a cylinder."""
LEG_RADIUS, _STEP = 0.13, 0.55
"""Two detections with radii up to the first, at most the second apart, are the legs of one person [m]."""
WHOLE, ONE_BEAM, BEHIND = 0.0, 1.0, 2.0
"""Ways an object is seen. By one beam, or behind another, it only confirms a known track, or is a leg."""
DETECTION_SIZE = 5
"""Columns of a detection: x, y, radius, way it is seen; the last is scratch."""
_LEAST_RADIUS = 0.1
"""A detection's radius is at least this: few beams meet a slim object [m]."""
_PAIRED = -2


@njit(cache=True, nogil=True)
def find_detections(ranges, beams, reach, found):
    """Detect objects in one scan that may move.

    Args:
        ranges: (beams,) [m]; ``inf`` or NaN where nothing came back.
        beams: (beams, 2) directions in base_link.
        reach: Returns from here on are left out [m].
        found: (most, DETECTION_SIZE), written to: x, y of the centre in base_link, radius [m], way it is seen.

    Returns:
        The number of detections.
    """
    n = len(beams)
    start = 0  # at a break, so that no segment is cut in two
    while start < n:
        here, before = ranges[start], ranges[(start - 1) % n]
        if 0.0 < here < reach and not abs(here - before) <= _JUMP + _JUMP_SLOPE * min(here, before):
            break
        start += 1
    if start == n:
        return 0
    count, b = 0, 0
    while b < n and count < len(found):
        first = (start + b) % n
        if not 0.0 < ranges[first] < reach:
            b += 1
            continue
        last, end = first, b
        first_x, first_y = ranges[first] * beams[first, 0], ranges[first] * beams[first, 1]
        farthest = 0.0
        sum_x, sum_y, points = ranges[first] * beams[first, 0], ranges[first] * beams[first, 1], 1
        for k in range(b + 1, n):
            index = (start + k) % n
            r, r_last = ranges[index], ranges[last]
            if 0.0 < r < reach:
                if abs(r - r_last) > _JUMP + _JUMP_SLOPE * min(r, r_last):
                    break
                x, y = r * beams[index, 0], r * beams[index, 1]
                sum_x += x
                sum_y += y
                farthest = max(farthest, (x - first_x) ** 2 + (y - first_y) ** 2)
                points += 1
                last, end = index, k
            elif k - end > 1:  # one beam may have been lost
                break
        b = end + 1
        r_first, r_last = ranges[first], ranges[last]
        before, after = ranges[(first - 1) % n], ranges[(last + 1) % n]
        if not 0.0 < before < reach:
            before = ranges[(first - 2) % n]
        if not 0.0 < after < reach:
            after = ranges[(last + 2) % n]
        width = math.hypot(
            r_first * beams[first, 0] - r_last * beams[last, 0], r_first * beams[first, 1] - r_last * beams[last, 1]
        )
        # A piece of wall between two nearer objects would seem to move as the body does: only segments in front count,
        # and a leg behind the other.
        behind = before < r_first or after < r_last
        # The walls of a room go from one post of its door all round to the other: near ends make no object.
        if max(width, math.sqrt(farthest)) > (2.0 * LEG_RADIUS if behind else MAX_WIDTH):
            continue
        x, y = sum_x / points, sum_y / points
        away = math.sqrt(x * x + y * y)
        deeper = 1.0 + _DEPTH * 0.5 * width / max(away, 1e-6)
        found[count, 0], found[count, 1], found[count, 2] = x * deeper, y * deeper, max(0.5 * width, _LEAST_RADIUS)
        found[count, 3] = BEHIND if behind else ONE_BEAM if points < 2 else WHOLE
        count += 1
    return _pair_legs(found, count)


@njit(cache=True, nogil=True)
def _nearest_leg(found, count, k):
    """Index of the leg next to this one, -1 if none is a step away."""
    best, nearest = -1, _STEP
    for other in range(count):
        apart = math.hypot(found[k, 0] - found[other, 0], found[k, 1] - found[other, 1])
        if other != k and found[other, 2] <= LEG_RADIUS and apart < nearest:
            best, nearest = other, apart
    return best


@njit(cache=True, nogil=True)
def _pair_legs(found, count):
    """Join pairs of legs, which swing against each other: their midpoint goes on evenly. Returns their number."""
    for k in range(count):
        found[k, 4] = _nearest_leg(found, count, k) if found[k, 2] <= LEG_RADIUS else -1.0
    left = 0
    for k in range(count):
        other = int(found[k, 4])
        if other == _PAIRED:
            continue
        if other > k and int(found[other, 4]) == k and min(found[k, 3], found[other, 3]) < BEHIND:
            found[left, 2] = max(found[k, 2], found[other, 2]) + 0.5 * math.hypot(
                found[k, 0] - found[other, 0], found[k, 1] - found[other, 1]
            )
            found[left, 0] = 0.5 * (found[k, 0] + found[other, 0])
            found[left, 1] = 0.5 * (found[k, 1] + found[other, 1])
            found[left, 3] = WHOLE
            found[other, 4] = _PAIRED
        else:
            found[left] = found[k]
        left += 1
    return left
