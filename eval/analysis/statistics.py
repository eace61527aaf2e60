"""Statistics of repeated episodes."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

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
    return mean_difference(second.astype(np.float64) - first, clusters)


def mean_difference(
    differences: NDArray[np.floating], clusters: NDArray | None = None, most: float = 1.0
) -> tuple[float, float, float]:
    """Mean of differences of shares with its 95% interval, as ``paired_difference`` has it.

    Args:
        differences: (n,) differences, each at most ``most`` either way.
        clusters: (n,) label that dependent ones share, such as the seed; by default each has its own.
        most: Greatest difference there can be: 1 of two shares, 2 of two differences of shares.

    Returns:
        Mean, lower and upper end of the interval; each cluster weighs the same.
    """
    differences = np.asarray(differences, np.float64) / most
    if clusters is not None:
        _, cluster = np.unique(clusters, return_inverse=True)
        differences = np.bincount(cluster, differences) / np.bincount(cluster)
    n, total = len(differences) + 2.0, float(differences.sum())
    middle = total / n
    half = Z_95 * math.sqrt(max(float((differences**2).sum()) + 1.0 - total**2 / n, 0.0)) / n
    return most * float(differences.mean()), most * max(-1.0, middle - half), most * min(1.0, middle + half)


def mcnemar_exact(first: NDArray[np.bool_], second: NDArray[np.bool_], clusters: NDArray | None = None) -> float:
    """Two-sided p-value of McNemar's exact test that two methods succeed equally often in the same episodes.

    Of the episodes in which only one of them succeeds, each is as likely the one's as the other's under the hypothesis:
    twice the smaller tail of a binomial distribution with one half (McNemar 1947; Fay 2010, "Two-sided exact tests and
    matching confidence intervals for discrete data"). The episodes must be independent of each other. Those that share
    a seed are not: each cluster of them counts once, for the method that succeeds more often in it (a sign test).

    Args:
        first: (n,) successes of the first method.
        second: (n,) successes of the second method.
        clusters: (n,) label that dependent episodes share, such as the seed; by default each has its own.

    Returns:
        The p-value; 1 if they differ in no episode.
    """
    differences = second.astype(np.int64) - first
    if clusters is not None:
        _, cluster = np.unique(clusters, return_inverse=True)
        differences = np.round(np.bincount(cluster, differences)).astype(np.int64)
    gained, lost = int((differences > 0).sum()), int((differences < 0).sum())
    n = gained + lost
    tail = sum(math.comb(n, k) for k in range(min(gained, lost) + 1))
    return min(1.0, 2 * tail / 2**n)


def mcnemar_mid_p(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    """Two-sided mid-p-value of McNemar's test: the exact one less half the probability of what was seen, both sides.

    The exact test rejects a true hypothesis less often than it says; this one about as often, and in practice not more
    (Fagerland, Lydersen and Laake 2013, "The McNemar test for binary matched-pairs data").

    Args:
        first: (n,) successes of the first method.
        second: (n,) successes of the second method.

    Returns:
        The mid-p-value; 1 if they differ in no episode.
    """
    gained, lost = int((second & ~first).sum()), int((first & ~second).sum())
    n, least = gained + lost, min(gained, lost)
    if gained == lost:  # both tails meet in what was seen
        return 1.0 - math.comb(n, least) / 2 ** (n + 1) if n else 1.0
    tail = sum(math.comb(n, k) for k in range(least + 1))
    return (2 * tail - math.comb(n, least)) / 2**n


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values adjusted for there being several (Holm 1979): all below 0.05 hold together at 5%.

    The k-th smallest of m is multiplied by m - k + 1; none becomes less than a smaller one.
    """
    m, least = len(p_values), 0.0
    adjusted = [0.0] * m
    for rank, place in enumerate(sorted(range(m), key=lambda k: p_values[k])):
        least = max(least, min(1.0, (m - rank) * p_values[place]))
        adjusted[place] = least
    return adjusted


def paired_e_value(gained: int, lost: int) -> float:
    """Evidence that two methods do not succeed equally often, which may be looked at after every episode.

    E = 2^(b + c) B(b + 1/2, c + 1/2) / B(1/2, 1/2): the likelihood of the b and c episodes in which only one method
    succeeds, mixed over all shares by the Beta(1/2, 1/2) distribution, over that of equal shares. If the methods are
    equally good, the probability that it ever reaches 1 / alpha is at most alpha (Ville 1939; Ramdas et al. 2023,
    "Game-theoretic statistics and safe anytime-valid inference"), so that a run may be stopped at any look.

    Args:
        gained: Episodes b in which only the second method succeeds.
        lost: Episodes c in which only the first method succeeds.

    Returns:
        E, at most e^700.
    """
    log_beta = math.lgamma(gained + 0.5) + math.lgamma(lost + 0.5) - math.lgamma(gained + lost + 1.0)
    return math.exp(min(700.0, (gained + lost) * math.log(2.0) + log_beta - math.log(math.pi)))


class Estimate(NamedTuple):
    """A value with its 95% interval."""

    value: float
    low: float
    high: float


def interquartile_mean(strata: Sequence[NDArray[np.floating]], draws: int = 2000) -> Estimate | None:
    """Mean of the middle half of all values and its interval by a stratified bootstrap (rliable, Agarwal et al. 2021).

    Of n values the int(n / 4) smallest and as many of the greatest are left out. Each draw takes from each stratum as
    many values as it has, with replacement; the interval is that of the draws' 2.5 and 97.5% quantiles. The draws are
    the same in every call.

    Args:
        strata: Values of each stratum, as those of the repetitions of one task; empty ones are left out.
        draws: Number of draws.

    Returns:
        The estimate; None without values.
    """
    from scipy.stats import trim_mean  # late: it takes a second to import

    filled = [np.sort(np.asarray(values, float)) for values in strata if len(values)]
    if not filled:
        return None
    rng = np.random.default_rng(0)
    drawn = np.concatenate([values[rng.integers(0, len(values), (draws, len(values)))] for values in filled], axis=1)
    low, high = np.quantile(trim_mean(drawn, 0.25, axis=1), (0.025, 0.975))
    return Estimate(float(trim_mean(np.concatenate(filled), 0.25)), float(low), float(high))


def mean_over(values: Sequence[float]) -> Estimate | None:
    """Mean of independent values, as of one for each seed, with Student's 95% interval.

    Args:
        values: Two or more; of fewer there is no interval, and no estimate.
    """
    if len(values) < 2:
        return None
    from scipy.stats import t  # late: it takes a second to import

    middle = float(np.mean(values))
    half = float(t.ppf(0.975, len(values) - 1)) * float(np.std(values, ddof=1)) / math.sqrt(len(values))
    return Estimate(middle, middle - half, middle + half)


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
