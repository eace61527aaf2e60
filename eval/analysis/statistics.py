"""Statistics of repeated episodes."""

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Z_95 = 1.959963984540054
"""The normal distribution's 97.5% quantile."""


def wilson_interval(successes: int, trials: int, z: float = Z_95) -> tuple[float, float]:
    """Wilson's score interval of a proportion (Wilson 1927, as in Brown, Cai and DasGupta 2001, eq. 4).

    Unlike the normal approximation it stays inside [0, 1] and has a width at 0 and at n successes.

    Args:
        successes: Number of successes.
        trials: Number of trials.
        z: Quantile of the normal distribution; the default gives 95%.

    Returns:
        Lower and upper end; (0, 1) if there were no trials.

    Raises:
        ValueError: ``successes`` is not in [0, trials].
    """
    if not 0 <= successes <= trials:
        raise ValueError(f"successes must be in [0, {trials}], got {successes}")
    if trials == 0:
        return 0.0, 1.0
    p = successes / trials
    scale = 1.0 / (1.0 + z * z / trials)
    middle = scale * (p + z * z / (2.0 * trials))
    half = scale * z * math.sqrt(p * (1.0 - p) / trials + z * z / (4.0 * trials * trials))
    low = 0.0 if successes == 0 else max(0.0, middle - half)
    high = 1.0 if successes == trials else min(1.0, middle + half)
    return low, high


def paired_difference(
    first: NDArray[np.bool_], second: NDArray[np.bool_], clusters: NDArray | None = None
) -> tuple[float, float, float]:
    """Difference of two success rates in the same episodes, second less first, with its 95% interval.

    Agresti and Min 2005: a half is added to each cell of the table of pairs. Of few pairs the interval may leave
    [-1, 1], where no difference is: it ends there.

    Episodes that share a seed are not independent of each other (Miller 2024, "Adding Error Bars to Evals", arXiv
    2411.00640): each cluster of them counts as one pair, of the mean of its differences. Added are the same four
    halves, of differences of +1, -1 and twice 0, so that clusters of one episode give Agresti and Min's interval. It is
    on the safe side where few clusters differ; a t interval over clusters is too short there, and has no width at all
    where none does, as with no falls at all.

    Args:
        first: (n,) successes of the first method.
        second: (n,) successes of the second method.
        clusters: (n,) label that dependent episodes share, such as the seed; by default each has its own.

    Returns:
        Difference of the shares, lower and upper end of the interval; each cluster weighs the same.
    """
    differences = second.astype(np.float64) - first
    if clusters is not None:
        _, cluster = np.unique(clusters, return_inverse=True)
        differences = np.bincount(cluster, differences) / np.bincount(cluster)
    n, total = len(differences) + 2.0, float(differences.sum())
    middle = total / n
    half = Z_95 * math.sqrt(max(float((differences**2).sum()) + 1.0 - total**2 / n, 0.0)) / n
    return float(differences.mean()), max(-1.0, middle - half), min(1.0, middle + half)


def mcnemar_exact(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    """Two-sided p-value of McNemar's exact test that two methods succeed equally often in the same episodes.

    Of the episodes in which only one of them succeeds, each is as likely the one's as the other's under the hypothesis:
    twice the smaller tail of a binomial distribution with one half (McNemar 1947; Fay 2010, "Two-sided exact tests and
    matching confidence intervals for discrete data"). The episodes must be independent of each other.

    Args:
        first: (n,) successes of the first method.
        second: (n,) successes of the second method.

    Returns:
        The p-value; 1 if they differ in no episode.
    """
    gained, lost = int((second & ~first).sum()), int((first & ~second).sum())
    n = gained + lost
    tail = sum(math.comb(n, k) for k in range(min(gained, lost) + 1))
    return min(1.0, 2 * tail / 2**n)


def resampled_totals(
    sums: NDArray[np.floating], strata: NDArray[np.integer], draws: int, rng: np.random.Generator
) -> NDArray[np.floating]:
    """Totals over episodes that are drawn again, with replacement, as many of each stratum as there are.

    Whole episodes are drawn, since events within one are not independent; a ratio of two totals has the draws'
    2.5 and 97.5% quantiles as its interval (Efron and Tibshirani 1993, chapter 13).

    Args:
        sums: Sums of each episode, (n, k).
        strata: Stratum of each episode, as the kind of its world, (n,).
        draws: Number of draws.
        rng: Source of randomness.

    Returns:
        Totals (draws, k).
    """
    totals = np.zeros((draws, sums.shape[1]))
    for stratum in np.unique(strata):
        chosen = sums[strata == stratum]
        totals += rng.multinomial(len(chosen), np.full(len(chosen), 1.0 / len(chosen)), draws).astype(float) @ chosen
    return totals


def mean(values: Iterable[float | None]) -> float | None:
    """Arithmetic mean of those that exist, None if there are none; exactly summed, whatever their order."""
    known = [value for value in values if value is not None]
    return math.fsum(known) / len(known) if known else None
