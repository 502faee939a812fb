"""How uncertain a small count is: exact intervals.

A number of events k in a time T, Poisson with rate lambda (Garwood 1936; chi2(p; d) is the quantile of
the chi-squared distribution with d degrees of freedom, G(p; k) = chi2(p; 2 k) / 2 that of the gamma
distribution of shape k):

    G(a / 2; k) / T  <=  lambda  <=  G(1 - a / 2; k + 1) / T

k successes in n trials (Clopper and Pearson 1934; B(p; a, b) is the quantile of the beta distribution):

    B(a / 2; k, n - k + 1)  <=  p  <=  B(1 - a / 2; k + 1, n - k)
"""

from __future__ import annotations

import math

from scipy.special import betaincinv, gammaincinv

LEVEL = 0.95
RULE_OF_THREE = -math.log(1 - LEVEL)
"""A time T without any event shows, LEVEL sure, a rate below RULE_OF_THREE / T (nearly 3 / T)."""
_TAIL = (1 - LEVEL) / 2


def poisson_interval(count: int, time: float) -> tuple[float, float]:
    """Two-sided interval of a rate after `count` events in `time`; (0, inf) after no time."""
    if time <= 0.0:
        return 0.0, math.inf
    low = float(gammaincinv(count, _TAIL)) if count else 0.0
    return low / time, float(gammaincinv(count + 1, 1 - _TAIL)) / time


def poisson_upper(count: int, time: float) -> float:
    """What a rate stays below, LEVEL sure, after `count` events in `time`; inf after no time."""
    return math.inf if time <= 0.0 else float(gammaincinv(count + 1, LEVEL)) / time


def binomial_interval(count: int, trials: int) -> tuple[float, float]:
    """Two-sided interval of a probability after `count` successes; (0, 1) after no trial."""
    low = float(betaincinv(count, trials - count + 1, _TAIL)) if count else 0.0
    high = float(betaincinv(count + 1, trials - count, 1 - _TAIL)) if count < trials else 1.0
    return low, high
