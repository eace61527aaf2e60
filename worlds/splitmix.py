"""Random streams for kernels: splitmix64 (Steele, Lea and Flood 2014), a seed and a counter for each stream.

A number is a function of its stream's seed and of how many were drawn before: a stream gives the same numbers, whatever
else is drawn and on however many threads.
"""

import numpy as np

from vuca_nav.kernel_cache import njit

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)


@njit(cache=True, nogil=True)
def next_uniform(seeds, drawn, i):
    """Draw the next number of stream i in [0, 1).

    Args:
        seeds: Seeds of the streams, (n,) uint64.
        drawn: Numbers drawn of each stream so far, (n,) uint64; counted on.
        i: Index of the stream.
    """
    drawn[i] += np.uint64(1)
    z = seeds[i] + drawn[i] * _GOLDEN
    z = (z ^ (z >> np.uint64(30))) * _FIRST
    z = (z ^ (z >> np.uint64(27))) * _SECOND
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) / 9007199254740992.0
