"""A binary heap in two arrays, keys and values, for searches in kernels."""

from vuca_nav.kernel_cache import njit


@njit(cache=True)
def push(keys, values, size, key, value):
    """Add an entry to a heap of ``size`` entries whose least key is on top; the new size."""
    at = size
    while at > 0:
        parent = (at - 1) >> 1
        if keys[parent] <= key:
            break
        keys[at], values[at] = keys[parent], values[parent]
        at = parent
    keys[at], values[at] = key, value
    return size + 1


@njit(cache=True)
def pop(keys, values, size):
    """Remove the top of the heap, which the caller has read; the new size."""
    size -= 1
    key, value = keys[size], values[size]
    at = 0
    while True:
        child = 2 * at + 1
        if child >= size:
            break
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[at], values[at] = keys[child], values[child]
        at = child
    keys[at], values[at] = key, value
    return size
