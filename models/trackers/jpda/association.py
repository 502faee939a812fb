"""Marginal association probabilities of targets and measurements (paper 3, Eq. 21-24 and 26).

A joint event pairs each target with at most one measurement and each measurement with at most one
target. With detection probability P_D, gate probability P_G, Poisson clutter of density lambda and
likelihoods L_ij its probability is, after division by the event without any pair,

    P(theta | Z) proportional to the product over its pairs of r_ij,
    r_ij = P_D_i L_ij / (lambda (1 - P_D_i P_G)),

a sum over matchings of a weighted bipartite graph. Targets that share no measurement are
independent, so each connected component (cluster) is summed alone. Within a cluster the sum is exact
and goes over subsets, not over events: F_j(S) is the sum over matchings of the first j measurements
that use exactly the targets S, B_j(S) that of the other measurements with the targets outside S, and

    beta_ij = r_ij * sum over S without i of F_{j-1}(S) B_j(S + i) / B_0(empty):

O(m 2^n n) operations, n the smaller side of the cluster. Where n is larger than allowed, the marginals
are approximated by loopy belief propagation, which converges always (Williams, Lau 2014), and the
result says so.

JPDA* (Blom, Bloem 2000, "Probabilistic data association avoiding track coalescence") prunes before it
sums: of all events that detect the same targets D by the same measurements M only the most probable
permutation counts. The mean over permutations is what draws close targets together. With j the first of M,

    W(D, M) = max over i in D of r_ij W(D - i, M - j),   W(empty, empty) = 1,

and beta_ij is the share of those W(D, M) whose best permutation holds the pair: O(2^(n + m) n). Clusters of
more than `LARGEST_PRUNED` targets and measurements are not pruned, which the result says too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

LARGEST_EXACT = 14
"""A cluster's smaller side beyond which sums over subsets are refused."""
LARGEST_PRUNED = 16
"""Targets and measurements of a cluster beyond which JPDA* falls back on the sum over all events."""
_SWEEPS = 200
_SETTLED = 1e-7


@dataclass(frozen=True, slots=True)
class Association:
    """Which measurement comes from which target."""

    beta: NDArray[np.float64]
    """Probabilities (n, m + 1), each row summing to 1; column 0: the target was missed."""
    approximate: NDArray[np.bool_]
    """Targets whose cluster was too large for the exact or the pruned sum (n,)."""


def associate(
    likelihood: NDArray[np.float64],
    detection: float | NDArray[np.float64],
    clutter: float,
    gate_probability: float = 1.0,
    exact: int = 12,
) -> Association:
    """Marginals of n targets and m measurements.

    `likelihood` (n, m) is a density, zero outside a target's gate; `detection` one probability or (n,)
    of them; `clutter` a density in the same unit as the likelihood. A detection probability of 1 is the
    limit from below. `exact` is the largest smaller side of a cluster that is summed exactly. Raises
    ValueError for shapes that do not fit and values that are no density or probability.
    """
    return _associate(likelihood, detection, clutter, gate_probability, exact, False)


def associate_star(
    likelihood: NDArray[np.float64],
    detection: float | NDArray[np.float64],
    clutter: float,
    gate_probability: float = 1.0,
    exact: int = 12,
) -> Association:
    """JPDA*: the same, but of events with the same targets and measurements the most probable alone counts.

    Arguments and errors are those of `associate`. Keeps targets apart that stay close.
    """
    return _associate(likelihood, detection, clutter, gate_probability, exact, True)


def _associate(
    likelihood: NDArray[np.float64],
    detection: float | NDArray[np.float64],
    clutter: float,
    gate_probability: float,
    exact: int,
    star: bool,
) -> Association:
    density = np.ascontiguousarray(likelihood, dtype=float)
    if density.ndim != 2:
        raise ValueError(f"the likelihood must be (targets, measurements), not {density.shape}")
    if not np.all(np.isfinite(density)) or np.any(density < 0.0):
        raise ValueError("a likelihood must be finite and not negative")
    seen = np.asarray(detection, dtype=float)
    if seen.shape not in ((), (len(density),)):
        raise ValueError(f"{len(density)} targets do not fit {seen.shape} detection probabilities")
    if not np.all((seen >= 0.0) & (seen <= 1.0)) or not 0.0 < gate_probability <= 1.0:
        raise ValueError("a probability must lie between 0 and 1")
    if not 0.0 < clutter < float("inf"):
        raise ValueError(f"the density of clutter must be positive and finite, not {clutter}")
    if not 0 <= exact <= LARGEST_EXACT:
        raise ValueError(f"clusters are summed exactly up to {LARGEST_EXACT}, not {exact}")
    seen = np.ascontiguousarray(np.broadcast_to(seen, len(density)))
    beta, approximate = _marginals(density, seen, 1.0 - seen * gate_probability, clutter, exact, star)
    return Association(beta, approximate)


@njit(cache=True)
def _marginals(density, seen, missed, clutter, exact, star):  # type: ignore[no-untyped-def]
    n, m = density.shape
    beta = np.zeros((n, m + 1))
    approximate = np.zeros(n, np.bool_)
    cluster, columns = _clusters(density, seen)
    for c in range(n):
        targets = np.flatnonzero(cluster == c)
        measurements = np.flatnonzero(columns == c)
        if len(targets) == 0:
            continue
        if len(measurements) == 0:
            beta[targets[0], 0] = 1.0
            continue
        smaller = min(len(targets), len(measurements))
        # No product of capped ratios along a matching can overflow; 1 / cap bounds what a miss weighs at least.
        cap = 10.0 ** (250.0 / min(max(smaller, 1), 20))
        ratios = np.empty((len(targets), len(measurements)))
        for a in range(len(targets)):
            i = targets[a]
            largest = density[i].max()
            for b in range(len(measurements)):
                ratios[a, b] = 0.0
                if largest > 0.0 and seen[i] > 0.0:
                    miss = max(missed[i] * clutter / largest, seen[i] / cap)
                    ratios[a, b] = seen[i] * (density[i, measurements[b]] / largest) / miss
        pruned = star and len(targets) + len(measurements) <= LARGEST_PRUNED
        if star and not pruned and smaller > 1:
            approximate[targets] = True
        if pruned:
            pairs, free = _pruned(ratios)
        elif smaller > exact:
            pairs, free = _propagated(ratios)
            approximate[targets] = True
        elif len(targets) <= len(measurements):
            pairs, free, _ = _summed(ratios)
        else:
            swapped, _, free = _summed(ratios.T.copy())
            pairs = swapped.T.copy()
        for a in range(len(targets)):
            beta[targets[a], 0] = free[a]
            for b in range(len(measurements)):
                beta[targets[a], measurements[b] + 1] = pairs[a, b]
    return beta, approximate


@njit(cache=True)
def _clusters(density, seen):  # type: ignore[no-untyped-def]
    """Component of each target (n,) and of each measurement (m,), -1 for one in no gate."""
    n, m = density.shape
    rows, columns = np.full(n, -1), np.full(m, -1)
    waiting = np.empty(n, np.intp)
    for first in range(n):
        if rows[first] >= 0:
            continue
        rows[first] = first
        waiting[0], count = first, 1
        while count > 0:
            count -= 1
            i = waiting[count]
            for j in range(m):
                if density[i, j] <= 0.0 or seen[i] <= 0.0 or columns[j] >= 0:
                    continue
                columns[j] = first
                for k in range(n):
                    if rows[k] < 0 and density[k, j] > 0.0 and seen[k] > 0.0:
                        rows[k] = first
                        waiting[count] = k
                        count += 1
    return rows, columns


@njit(cache=True)
def _summed(ratios):  # type: ignore[no-untyped-def]
    """Exact marginals of pairs (k, q), and of rows (k,) and columns (q,) without a partner."""
    k, q = ratios.shape
    subsets = 1 << k
    forward, backward = np.zeros((q + 1, subsets)), np.ones((q + 1, subsets))
    forward[0, 0] = 1.0
    for j in range(q):
        for s in range(subsets):
            total = forward[j, s]
            for i in range(k):
                if s >> i & 1 and ratios[i, j] > 0.0:
                    total += ratios[i, j] * forward[j, s ^ (1 << i)]
            forward[j + 1, s] = total
    for j in range(q - 1, -1, -1):
        for s in range(subsets):
            total = backward[j + 1, s]
            for i in range(k):
                if not s >> i & 1 and ratios[i, j] > 0.0:
                    total += ratios[i, j] * backward[j + 1, s | (1 << i)]
            backward[j, s] = total
    everything = backward[0, 0]
    pairs, rows, columns = np.zeros((k, q)), np.zeros(k), np.zeros(q)
    for s in range(subsets):
        for i in range(k):
            if s >> i & 1:
                continue
            rows[i] += forward[q, s] / everything
            for j in range(q):
                if ratios[i, j] > 0.0:
                    pairs[i, j] += forward[j, s] / everything * ratios[i, j] * backward[j + 1, s | (1 << i)]
        for j in range(q):
            columns[j] += forward[j, s] / everything * backward[j + 1, s]
    return pairs, rows, columns


@njit(cache=True)
def _pruned(ratios):  # type: ignore[no-untyped-def]
    """Marginals of pairs (k, q) and of rows without a partner (k,), one permutation for each D and M."""
    k, q = ratios.shape
    best, chosen = np.zeros((1 << k, 1 << q)), np.zeros((1 << k, 1 << q), np.uint8)
    best[0, 0] = total = 1.0
    free = np.ones(k)
    for s in range(1, 1 << k):
        for t in range(1, 1 << q):
            j = 0
            while not t >> j & 1:
                j += 1
            for i in range(k):
                if s >> i & 1:
                    weight = ratios[i, j] * best[s ^ (1 << i), t ^ (1 << j)]
                    if weight > best[s, t]:
                        best[s, t], chosen[s, t] = weight, i
            if best[s, t] > 0.0:
                total += best[s, t]
                for i in range(k):
                    if not s >> i & 1:
                        free[i] += best[s, t]
    pairs = np.zeros((k, q))
    # From the larger sets down: what counts for a set's best permutation counts for all pairs within it.
    for s in range((1 << k) - 1, 0, -1):
        for t in range((1 << q) - 1, 0, -1):
            if best[s, t] > 0.0:
                j, i = 0, chosen[s, t]
                while not t >> j & 1:
                    j += 1
                pairs[i, j] += best[s, t] / total
                best[s ^ (1 << i), t ^ (1 << j)] += best[s, t]
    return pairs, free / total


@njit(cache=True)
def _propagated(ratios):  # type: ignore[no-untyped-def]
    """Marginals of pairs (k, q) and of rows without a partner (k,) by belief propagation."""
    k, q = ratios.shape
    down = np.ones((k, q))  # from each measurement to each target
    up = np.empty((k, q))
    for _ in range(_SWEEPS):
        for i in range(k):
            for j in range(q):
                # Summed without the pair itself: the difference of two sums would cancel.
                others = 1.0
                for other in range(q):
                    if other != j:
                        others += ratios[i, other] * down[i, other]
                up[i, j] = ratios[i, j] / others
        change = 0.0
        for j in range(q):
            for i in range(k):
                others = 1.0
                for other in range(k):
                    if other != i:
                        others += up[other, j]
                change = max(change, abs(1.0 / others - down[i, j]))
                down[i, j] = 1.0 / others
        if change < _SETTLED:
            break
    pairs, free = np.empty((k, q)), np.empty(k)
    for i in range(k):
        total = 1.0
        for j in range(q):
            total += ratios[i, j] * down[i, j]
        free[i] = 1.0 / total
        for j in range(q):
            pairs[i, j] = ratios[i, j] * down[i, j] / total
    return pairs, free
