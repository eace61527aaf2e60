"""Things of a person's size in one scan: segments of it in front of their surroundings, and pairs of legs."""

import math

from numba import njit

MAX_WIDTH = 1.2
"""Of a thing: the widest mover is 0.9 m, and a wall's piece is wider [m]."""
_JUMP, _JUMP_SLOPE = 0.15, 0.06
"""Ranges of neighbouring beams on one surface differ by at most this, and this share of the range [m]."""
_DEPTH = 0.7
"""How far behind what is seen of a thing its centre is, in half widths: 0.79 for a cylinder."""
LEG_RADIUS, _STEP = 0.13, 0.55
"""Two things with radii up to the first, at most the second apart, are the legs of one [m]."""
WHOLE, ONE_BEAM, BEHIND = 0.0, 1.0, 2.0
"""How a thing is seen. By one beam, or behind another, it is taken for one that is known already, or for a leg."""
FOUND_COLUMNS = 5
"""x, y, radius, how it is seen; the last is for passing."""
_PAIRED = -2


@njit(cache=True, nogil=True)
def find_things(ranges, step, beams, reach, found):
    """Things in one scan.

    Args:
        ranges: (beams,) [m]; ``inf`` or NaN where nothing came back.
        step: Only every so many beams are looked at.
        beams: (n, 2) directions of those in base_link.
        reach: From there on nothing is looked at [m].
        found: (most, FOUND_COLUMNS), written to: x, y of the centre in base_link, radius [m], how it is seen.

    Returns:
        How many there are.
    """
    n = len(beams)
    start = 0  # at a break, so that no thing is cut in two
    while start < n:
        here, before = ranges[start * step], ranges[(start - 1) % n * step]
        if 0.0 < here < reach and not abs(here - before) <= _JUMP + _JUMP_SLOPE * min(here, before):
            break
        start += 1
    if start == n:
        return 0
    count, b = 0, 0
    while b < n and count < len(found):
        first = (start + b) % n
        if not 0.0 < ranges[first * step] < reach:
            b += 1
            continue
        last, end = first, b
        sum_x, sum_y, points = ranges[first * step] * beams[first, 0], ranges[first * step] * beams[first, 1], 1
        for k in range(b + 1, n):
            index = (start + k) % n
            r, r_last = ranges[index * step], ranges[last * step]
            if 0.0 < r < reach:
                if abs(r - r_last) > _JUMP + _JUMP_SLOPE * min(r, r_last):
                    break
                sum_x += r * beams[index, 0]
                sum_y += r * beams[index, 1]
                points += 1
                last, end = index, k
            elif k - end > 1:  # one beam may have been lost
                break
        b = end + 1
        r_first, r_last = ranges[first * step], ranges[last * step]
        before, after = ranges[(first - 1) % n * step], ranges[(last + 1) % n * step]
        if not 0.0 < before < reach:
            before = ranges[(first - 2) % n * step]
        if not 0.0 < after < reach:
            after = ranges[(last + 2) % n * step]
        width = math.hypot(
            r_first * beams[first, 0] - r_last * beams[last, 0], r_first * beams[first, 1] - r_last * beams[last, 1]
        )
        # A piece of wall between two nearer things would seem to move as the body does: only what is in front counts,
        # and a leg behind the other.
        behind = before < r_first or after < r_last
        if width > (2.0 * LEG_RADIUS if behind else MAX_WIDTH):
            continue
        x, y = sum_x / points, sum_y / points
        away = math.sqrt(x * x + y * y)
        deeper = 1.0 + _DEPTH * 0.5 * width / max(away, 1e-6)
        found[count, 0], found[count, 1], found[count, 2] = x * deeper, y * deeper, max(0.5 * width, 0.1)
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
    """Two legs swing against each other; what is half-way between them goes on evenly. Returns how many are left."""
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
