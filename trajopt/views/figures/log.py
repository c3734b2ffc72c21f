"""A log, how accurately its positions are known, and the rows that prove a limit broken."""

from __future__ import annotations

from collections.abc import Callable
from math import factorial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trajopt.core.arrays import Array
from trajopt.core.limits import KINDS
from trajopt.judgement import Execution
from trajopt.judging.evidence import Conviction, Evidence
from trajopt.judging.log_joint import RATES, Joint
from trajopt.views.figures.plots import Picture, styled
from trajopt.views.figures.style import BLACK, BLUE, GREY, VERMILION, headline

_SIZE_IN = (5.0, 4.2)
_AROUND = 0.5  # of the rows' span that is shown on each side
_FEWEST = 12  # rows that are shown at least


@styled
def premise(found: Execution) -> Figure:
    """Draw the joint that uses most: its positions, and how far each may be off.

    Where a few rows convict, the lower panel shows them against a lawful curve: it passes all of
    them but the last at the favourable edges of their widths, at the limit, and misses the last.
    Else it shows the motion that was found: every sample is within its width of it.

    Raises:
        ValueError: The motion is no log.
    """
    told = found.evidence
    if told is None:
        raise ValueError(f"{found.motion.name} is no log")
    proof = told.conviction
    joint = _joint(told)
    logged = told.joints[joint]
    unit = found.problem.unit(joint)
    figure = Picture(figsize=_SIZE_IN, layout="constrained")
    whole, near = figure.subplots(2, 1, height_ratios=(1, 1.4))
    whole.plot(logged.times, logged.positions, color=BLUE)
    whole.set_ylabel(f"position ({unit})")
    if proof is not None and len(proof.values) > 1 and not proof.of_velocities and proof.limit:
        whole.axvspan(proof.start, proof.end, color=VERMILION, alpha=0.25, lw=0)
        _convicted(near, logged, proof)
        near.set_ylabel(f"beyond a lawful curve ({unit})")
    else:
        _within(near, told, logged, joint)
        near.set_ylabel(f"off the motion found ({unit})")
    near.set_xlabel("time (s)")
    label = found.problem.joint_labels[joint]
    width = f"{label}, known to \N{PLUS-MINUS SIGN}{logged.known.known:.2g} {unit}: {told.verdict}"
    figure.suptitle(headline(f"{found.motion.name}: ", width), x=0.01, ha="left", fontsize=8)
    figure.legend(*near.get_legend_handles_labels(), loc="outside lower left", ncols=2)
    return figure


def _joint(told: Evidence) -> int:
    """Return the joint of the proof, or the one that uses most of a limit."""
    if told.conviction is not None:
        return told.conviction.joint
    return max(told.limits.values(), key=lambda use: use.at_least).joint if told.limits else 0


def _within(axes: Axes, told: Evidence, logged: Joint, joint: int) -> None:
    """Draw the samples' widths about the motion that was found."""
    if told.motion is None:
        reference = np.zeros(len(logged.times)) + logged.positions.mean()
    else:
        reference = told.motion(logged.times - told.log.times[0])[:, joint]
    off = logged.positions - reference
    axes.fill_between(
        logged.times, -logged.half, logged.half, color=GREY, alpha=0.3, lw=0, label="known to this"
    )
    axes.plot(logged.times, off, ".", color=BLUE, ms=2, label="samples")


def _convicted(axes: Axes, logged: Joint, proof: Conviction) -> None:
    """Draw the rows of a proof beyond the lawful curve that comes nearest to them."""
    start, end = proof.start, proof.end
    span = max(end - start, _FEWEST * float(np.median(np.diff(logged.times))) / 2)
    shown = (logged.times >= start - _AROUND * span) & (logged.times <= end + _AROUND * span)
    lawful = _lawful(proof, logged)
    times, at = logged.times[shown], lawful(logged.times[shown])
    beyond = logged.positions[shown] - at
    axes.errorbar(
        times,
        beyond,
        logged.half[shown],
        fmt=".",
        ms=3,
        color=GREY,
        lw=0.6,
        label="samples, known to this",
    )
    axes.errorbar(
        proof.times,
        proof.values - lawful(proof.times),
        proof.half,
        fmt="o",
        color=VERMILION,
        lw=1.2,
        capsize=2,
        label=f"rows that convict: {proof.at_least:.4g} times",
    )
    kind = KINDS[proof.limit].name() if proof.limit else "limit"
    fine = np.linspace(times[0], times[-1], 200)
    axes.plot(fine, 0 * fine, color=BLACK, label=f"a curve at the {kind} limit")
    edge = 1.3 * np.abs(np.append(proof.values - lawful(proof.times), proof.half)).max()
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, -3 * edge), min(high, 3 * edge))


def _lawful(proof: Conviction, logged: Joint) -> Callable[[Array], Array]:
    """Return the curve at the limit through the favourable edges of all rows but the last."""
    order = len(proof.times) - 1
    at = proof.times - proof.times[0]
    weights = np.array([1 / np.prod(np.delete(at[i] - at, i)) for i in range(order + 1)])
    mean = factorial(order) * float(weights @ proof.values)
    low, high = logged.limits[RATES.index(proof.limit)] if proof.limit in RATES else (mean, mean)
    side = 1.0 if mean > 0 else -1.0
    edges = proof.values - side * np.sign(weights) * proof.half
    top = (high if side > 0 else low) / factorial(order)
    lower = edges[:-1] - top * at[:-1] ** order
    rest = np.linalg.solve(np.vander(at[:-1], order), lower)
    coefficients = np.append(top, rest)
    return lambda times: np.asarray(np.polyval(coefficients, times - proof.times[0]))
