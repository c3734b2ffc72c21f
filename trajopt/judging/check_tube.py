"""Check in exact fractions which share of its limits every motion within a tube uses.

One joint is known to be within `d_i` of `q_i` at the times `t_i`. Its derivatives of order 1 … r
have limits `[low_k, high_k]`; those of the velocity may depend on the time. Any numbers `λ_i` of
samples and `μ_kj` of the k-th derivative at times `x_kj`, k < r, prove a bound. Let

    g(x) = −Σ_i λ_i (t_i − x)₊^(r−1) / (r−1)! − Σ_kj μ_kj (x_kj − x)₊^(r−1−k) / (r−1−k)!     (1)

If no polynomial of degree below r contributes to `Σ λ_i q(t_i) + Σ μ_kj q⁽ᵏ⁾(x_kj)`, Taylor's
formula gives, for every motion q,

    −Σ λ_i q(t_i) = Σ μ_kj q⁽ᵏ⁾(x_kj) + ∫ g q⁽ʳ⁾ dx                                          (2)

A motion that uses the share s of its limits makes the right side at most s times the cost

    Σ max(high_k μ_kj, low_k μ_kj) + ∫ max(high_r g, low_r g) dx                              (3)

and the left side is at least the gain `−Σ λ_i q_i − Σ |λ_i| d_i`. So s is at least gain / cost. If
that is above 1, no motion keeps the limits. What polynomials contribute all the same adds to the
cost. The bound does not depend on how the numbers were found.

This file imports the kernel's numbers and refusals, and the standard library.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

from trajopt.judging.check_proof import ZERO, NoProof, total

Pair = tuple[Fraction, Fraction]
Sample = tuple[Fraction, Fraction, Fraction]


def proved(
    limits: Sequence[Pair | None],
    samples: Sequence[Sample],
    multipliers: Sequence[Fraction],
    derivatives: Sequence[Sequence[Pair]],
    bounds: Sequence[Sequence[Pair]],
    roots: Sequence[Fraction],
) -> Fraction:
    """Return the bound on s; 0 where the numbers prove nothing.

    Args:
        limits: Low and high of the derivatives of order 1 … r; None for one without limits.
        samples: `t_i`, `q_i` and `d_i`, by increasing times.
        multipliers: `λ_i`.
        derivatives: For each order below r the times `x_kj` and the numbers `μ_kj`.
        bounds: For each order below r low and high at its times `x_kj`.
        roots: Times at which pieces of g are cut; any cut is sound.

    Raises:
        NoProof: The numbers are not those of a tube.
    """
    r, (low, high) = len(limits), _checked(limits, samples, derivatives, bounds)
    first, last = samples[0], samples[-1]
    # Jumps of the derivatives r−1, r−2, … of g at each time, from the last time to the first.
    events: dict[Fraction, list[Fraction]] = {}
    of_samples = [(t, y) for (t, _, _), y in zip(samples, multipliers, strict=True)]
    for order, pairs in enumerate([of_samples, *derivatives]):
        for x, value in pairs:
            events.setdefault(x, [ZERO] * r)[r - 1 - order] -= value
    for x in roots:
        if first[0] < x < last[0]:
            events.setdefault(x, [ZERO] * r)
    g = [ZERO] * 3  # g and its derivatives by −x
    cost = ZERO
    times = sorted(events, reverse=True)
    for x, before in zip(times, [*times[1:], None], strict=True):
        for derivative, value in enumerate(events[x]):
            g[derivative] += value
        if before is None:
            break
        h = x - before
        end = g[0] + h * g[1] + h * h * g[2] / 2
        # A piece's integral is at most that of its Bernstein polynomial's bounds.
        corners = (g[0], g[0] + h * g[1] / 2, end)
        cost += h * total(max(high * c, low * c) for c in corners) / 3
        g = [end, g[1] + h * g[2], g[2]]
    gain = -total(y * q + abs(y) * d for (_, q, d), y in zip(samples, multipliers, strict=True))
    # The rest of g before the first time multiplies the motion's derivatives there.
    gain -= abs(g[r - 1]) * (abs(first[1]) + first[2])
    for order in range(1, r):
        rest, limit, own = abs(g[r - 1 - order]), limits[order - 1], derivatives[order - 1]
        if limit is None:
            if rest or any(value for _, value in own):
                return ZERO  # an unlimited derivative may make the right side any number
            continue
        cost += rest * max(limit[1], -limit[0])
        sides = zip(own, bounds[order - 1], strict=True)
        cost += total(max(up * value, down * value) for (_, value), (down, up) in sides)
    return max(ZERO, gain / cost) if cost else ZERO


def _checked(
    limits: Sequence[Pair | None],
    samples: Sequence[Sample],
    derivatives: Sequence[Sequence[Pair]],
    bounds: Sequence[Sequence[Pair]],
) -> Pair:
    """Return the limits of the last derivative."""
    times = [t for t, _, _ in samples]
    if not 1 <= len(limits) <= 3 or len(derivatives) != len(limits) - 1:
        raise NoProof("limits", "those of the velocity, up to jerk", len(limits))
    if len(times) < 2 or times != sorted(set(times)) or any(d < 0 for _, _, d in samples):
        raise NoProof("samples", "two or more by increasing times, with half widths of 0 or more")
    if not all(times[0] <= x <= times[-1] for own in derivatives for x, _ in own):
        raise NoProof("derivatives", "times from the first sample to the last")
    if not all(low < 0 < high for own in (filter(None, limits), *bounds) for low, high in own):
        raise NoProof("limits", "one below 0 and one above")
    if limits[-1] is None:
        raise NoProof("limits", "limits of the last derivative")
    return limits[-1]
