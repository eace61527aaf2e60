import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from eval.analysis.statistics import (
    holm,
    interquartile_mean,
    mcnemar_exact,
    mcnemar_mid_p,
    mean,
    mean_difference,
    mean_over,
    paired_difference,
    paired_e_value,
    resampled_totals,
    wilson_interval,
)


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [
        (8, 10, 0.4902, 0.9433),
        (0, 10, 0.0, 0.2775),
        (10, 10, 0.7225, 1.0),
        (95, 100, 0.8882, 0.9785),
        (1, 29, 0.0061, 0.1718),  # Newcombe 1998, Table I, method 3
        (81, 263, 0.2553, 0.3662),  # the same
    ],
)
def test_published_intervals(successes, trials, low, high):
    assert wilson_interval(successes, trials) == pytest.approx((low, high), abs=5e-5)


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_interval_holds_the_proportion_and_is_symmetric(case):
    successes, trials = case
    low, high = wilson_interval(successes, trials)
    assert 0.0 <= low <= successes / trials <= high <= 1.0
    assert high - low > 0.0
    mirrored = wilson_interval(trials - successes, trials)
    assert (1.0 - mirrored[1], 1.0 - mirrored[0]) == pytest.approx((low, high), abs=1e-12)


def test_no_trials_say_nothing():
    assert wilson_interval(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize(("successes", "trials"), [(3, 2), (-1, 2)])
def test_impossible_counts_are_refused(successes, trials):
    with pytest.raises(ValueError, match="successes must be in"):
        wilson_interval(successes, trials)


def test_mean_leaves_out_what_is_missing():
    assert mean([1.0, None, 3.0]) == 2.0
    assert mean([None]) is None


@given(st.lists(st.floats(-1e6, 1e6), min_size=1), st.randoms(use_true_random=False))
def test_mean_does_not_depend_on_the_order(values, random):
    shuffled = list(values)
    random.shuffle(shuffled)
    assert mean(shuffled) == mean(values)
    assert math.isfinite(mean(values) or 0.0)


def test_a_paired_difference_by_hand():
    first = np.array([True] * 60 + [False] * 40)
    second = np.array([True] * 50 + [False] * 10 + [True] * 20 + [False] * 20)
    difference, low, high = paired_difference(first, second)
    assert difference == pytest.approx(0.10)
    # (20.5 - 10.5) / 102, +- 1.96 sqrt(31 - 100 / 102) / 102
    assert low == pytest.approx(0.09804 - 0.10526, abs=1e-4)
    assert high == pytest.approx(0.09804 + 0.10526, abs=1e-4)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_no_interval_of_few_pairs_ends_beyond_what_is_possible(n):
    never, always = np.zeros(n, np.bool_), np.ones(n, np.bool_)
    gained, lost = paired_difference(never, always), paired_difference(always, never)
    assert gained[0] == gained[2] == 1.0  # 1 / 3 + 1.96 sqrt(2 - 1 / 3) / 3 = 1.18 for a single pair
    assert lost[0] == lost[1] == -1.0
    assert (gained[1], lost[2]) == pytest.approx((-lost[2], -gained[1]))
    assert -1.0 < gained[1] < 1.0


def test_a_difference_over_clusters_by_hand():
    # Three seeds of two tasks each: differences of (+1, 0), (+1, +1) and (0, -1), so +0.5, +1 and -0.5.
    first = np.array([0, 0, 0, 1, 0, 1], np.bool_)
    second = np.array([1, 1, 1, 1, 0, 0], np.bool_)
    seeds = np.array([7, 9, 9, 7, 8, 8])
    difference, low, high = paired_difference(first, second, seeds)
    assert difference == pytest.approx(1.0 / 3.0)
    # 1 / 5, +- 1.96 sqrt(1.5 + 1 - 1 / 5) / 5
    assert low == pytest.approx(0.2 - 0.59448, abs=1e-4)
    assert high == pytest.approx(0.2 + 0.59448, abs=1e-4)


def test_clusters_of_one_episode_are_pairs():
    rng = np.random.default_rng(0)
    first, second = rng.random((2, 30)) < 0.6
    assert paired_difference(first, second, rng.permutation(30)) == pytest.approx(paired_difference(first, second))


def test_every_cluster_weighs_the_same():
    first, second = np.zeros(4, np.bool_), np.array([1, 1, 1, 0], np.bool_)
    assert paired_difference(first, second, np.array([0, 0, 0, 1]))[0] == pytest.approx(0.5)


def test_the_interval_over_clusters_holds_what_is_true():
    """Of a shared seed four episodes come out alike: pairs taken one by one would miss in one case of four."""
    rng, seeds, trials = np.random.default_rng(0), np.repeat(np.arange(25), 4), 400
    holds = {"clusters": 0, "pairs": 0}
    for _ in range(trials):
        draws = 0.95 * rng.normal(size=(2, 25, 1)) + 0.31 * rng.normal(size=(2, 25, 4))
        first, second = (draws < 0.0).reshape(2, -1)  # each succeeds in half of the episodes
        for name, clusters in (("clusters", seeds), ("pairs", None)):
            _, low, high = paired_difference(first, second, clusters)
            holds[name] += low <= 0.0 <= high
    assert holds["clusters"] / trials == pytest.approx(0.95, abs=0.025)
    assert holds["pairs"] / trials < 0.8


def pairs(both: int, gained: int, lost: int, neither: int):
    first = np.repeat([True, False, True, False], [both, gained, lost, neither])
    return first, np.repeat([True, True, False, False], [both, gained, lost, neither])


@pytest.mark.parametrize(
    ("gained", "lost", "p"),
    [
        (2, 9, 0.06543),  # Fay 2010, the vignette of exact2x2: a table of 21, 9, 2 and 12
        (9, 2, 0.06543),
        (0, 5, 0.0625),  # 2 / 2^5
        (4, 4, 1.0),
        (0, 0, 1.0),
    ],
)
def test_exact_mcnemar(gained, lost, p):
    assert mcnemar_exact(*pairs(21, gained, lost, 12)) == pytest.approx(p, abs=5e-6)


@pytest.mark.parametrize(
    ("gained", "lost", "p"),
    [
        (0, 5, 0.03125),  # (2 - 1) / 2^5
        (1, 5, 0.125),  # (2 (1 + 6) - 6) / 2^6
        (9, 2, 0.03857),  # 0.06543 less 55 / 2^11
        (3, 3, 0.84375),  # 1 - 20 / 2^7
        (0, 0, 1.0),
    ],
)
def test_mid_p_by_hand(gained, lost, p):
    assert mcnemar_mid_p(*pairs(21, gained, lost, 12)) == pytest.approx(p, abs=5e-6)
    assert mcnemar_mid_p(*pairs(3, lost, gained, 0)) == pytest.approx(p, abs=5e-6)


@settings(deadline=None)
@given(st.integers(0, 40), st.integers(0, 40))
def test_mcnemar_as_of_scipy(gained, lost):
    n = gained + lost
    seen = pairs(1, gained, lost, 1)
    exact = stats.binomtest(gained, n).pvalue if n else 1.0
    assert mcnemar_exact(*seen) == pytest.approx(exact)
    if gained != lost:  # Fagerland et al. 2013: less the probability of what was seen
        assert mcnemar_mid_p(*seen) == pytest.approx(exact - stats.binom.pmf(gained, n, 0.5))
    assert 0.0 < mcnemar_mid_p(*seen) <= exact


@pytest.mark.parametrize("successes", [0, 3, 40, 97, 100])
def test_wilson_as_of_scipy(successes):
    expected = stats.binomtest(successes, 100).proportion_ci(method="wilson")
    assert wilson_interval(successes, 100) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_holm_by_hand():
    # In order 0.01 x 4, 0.02 x 3, 0.03 x 2 (no less than the one before), 0.5.
    assert holm([0.03, 0.01, 0.5, 0.02]) == pytest.approx([0.06, 0.04, 0.5, 0.06])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []


@pytest.mark.parametrize(
    ("gained", "lost", "e"),
    [
        (0, 0, 1.0),
        (1, 0, 1.0),  # 2 B(3/2, 1/2) / B(1/2, 1/2) = 2 / 2
        (2, 0, 1.5),  # 4 x (1/2 x 3/2) / (1 x 2)
        (1, 1, 0.5),  # 4 x (1/2 x 1/2) / (1 x 2)
        (8, 0, 2**8 * 6435 / 32768),  # the Wallis product of 1/2, 3/4, ... 15/16
    ],
)
def test_e_value_by_hand(gained, lost, e):
    assert paired_e_value(gained, lost) == pytest.approx(e)
    assert paired_e_value(lost, gained) == pytest.approx(e)


def test_e_value_is_a_mixture_of_likelihood_ratios():
    """Integrated over the arcsine distribution by scipy; and a fair game: what is next neither gains nor loses."""
    mixed = stats.beta(0.5, 0.5).expect(lambda share: (2 * share) ** 7 * (2 * (1 - share)) ** 3)
    assert paired_e_value(7, 3) == pytest.approx(mixed)
    for b in range(6):
        for c in range(6):
            assert (paired_e_value(b + 1, c) + paired_e_value(b, c + 1)) / 2 == pytest.approx(paired_e_value(b, c))
    assert math.isfinite(paired_e_value(5000, 0))


def test_looking_after_every_pair_rarely_misleads():
    rng, wrong, wrong_by_p = np.random.default_rng(0), 0, 0
    for _ in range(200):
        gained, n = np.cumsum(rng.random(100) < 0.5), np.arange(1, 101)
        wrong += any(paired_e_value(b, c) >= 20.0 for b, c in zip(gained.tolist(), (n - gained).tolist()))
        wrong_by_p += (2 * stats.binom.cdf(np.minimum(gained, n - gained), n, 0.5) <= 0.05).any()
    assert wrong <= 10  # 5% of 200
    assert wrong_by_p > 20  # what the p-value would do


def test_interquartile_mean_by_hand():
    # Of 9 values int(9 / 4) = 2 are left out at each end: 2, 3, 4, 5, 6 stay.
    found = interquartile_mean([np.array([0.0, 1.0, 2.0, 100.0]), np.array([3.0, 4.0, 5.0, 6.0, 50.0])])
    assert found is not None
    assert found.value == pytest.approx(4.0)
    assert found.low < 4.0 < found.high
    assert interquartile_mean([np.array([])]) is None
    assert interquartile_mean([np.array([7.0])]) == (7.0, 7.0, 7.0)


def test_the_bootstrap_keeps_to_its_strata_and_to_scipy():
    """Strata without spread give an interval without width, which draws over all values would not."""
    still = [np.full(20, value) for value in (0.0, 1.0, 4.0)]
    assert interquartile_mean(still) == pytest.approx(
        (4 / 3, 4 / 3, 4 / 3)
    )  # 15 of 60 go at each end: 5, 20 and 5 are left
    values = np.random.default_rng(1).gamma(2.0, size=60)
    expected = stats.bootstrap(
        (values,), lambda x, axis: stats.trim_mean(x, 0.25, axis=axis), method="percentile",
        n_resamples=4000, rng=np.random.default_rng(2),
    ).confidence_interval  # fmt: skip
    found = interquartile_mean([values])
    assert found is not None
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), abs=0.05)
    assert interquartile_mean([values[::-1]]) == found


def test_resampled_totals():
    """Of draws of n episodes: the mean is the total, the spread sqrt(n) times the episodes'; strata stay."""
    sums = np.stack([np.arange(50.0), np.ones(50)], 1)
    totals = resampled_totals(sums, np.zeros(50, int), 4000, np.random.default_rng(0))
    assert totals.shape == (4000, 2)
    assert (totals[:, 1] == 50.0).all()
    assert totals[:, 0].mean() == pytest.approx(1225.0, rel=0.01)
    assert totals[:, 0].std() == pytest.approx(math.sqrt(50) * np.arange(50.0).std(), rel=0.05)
    by_stratum = resampled_totals(
        np.repeat([[1.0], [3.0]], 25, 0), np.repeat([0, 1], 25), 100, np.random.default_rng(0)
    )
    assert (by_stratum == 100.0).all()
    again = resampled_totals(sums, np.zeros(50, int), 4000, np.random.default_rng(0))
    np.testing.assert_array_equal(totals, again)


def test_a_seed_counts_once_in_mcnemars_test():
    """Ten seeds of three episodes each: the second arrives more often in nine, less often in one."""
    seeds = np.repeat(np.arange(10), 3)
    first = np.zeros(30, np.bool_)
    second = np.tile([True, True, False], 10)
    first[:3], second[:3] = True, [True, False, False]
    assert mcnemar_exact(first, second, seeds) == pytest.approx(stats.binomtest(9, 10).pvalue)
    assert mcnemar_exact(first, second, np.arange(30)) == mcnemar_exact(first, second)
    balanced = np.array([True, False]), np.array([False, True])
    assert mcnemar_exact(*balanced, clusters=np.zeros(2)) == 1.0


def test_a_difference_of_differences_has_twice_the_range():
    shares = np.array([0.5, -0.5, 0.0, 1.0, 0.25])
    one = mean_difference(shares)
    assert mean_difference(2.0 * shares, most=2.0) == pytest.approx([2.0 * part for part in one])
    assert mean_difference(np.full(50, 2.0), most=2.0)[2] == pytest.approx(2.0)
    assert mean_difference(np.zeros(50), most=2.0)[2] > mean_difference(np.zeros(50))[2] > 0.0


@given(st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=30))
@settings(max_examples=50)
def test_students_interval_is_scipys(values):
    found = mean_over(values)
    assert found is not None
    error = stats.sem(values)
    low, high = stats.t.interval(0.95, len(values) - 1, np.mean(values), error) if error > 0 else (values[0], values[0])
    assert (found.low, found.high) == pytest.approx((low, high), abs=1e-9)


def test_one_value_has_no_interval():
    assert mean_over([0.3]) is None
