"""Print the verdict on a log and what it rests on, for `verify` and `judge`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from trajopt.cli import console
from trajopt.core.limits import KINDS
from trajopt.judgement import Execution
from trajopt.judging.evidence import Conviction, Evidence
from trajopt.judging.log_joint import EXCESS, NOISE_DOUBT

_SHOWN = f"{100 * EXCESS:g} %"
_COLUMNS = ("at least", "motion uses", "raw spline", "digits alone", f"{_SHOWN} shows in")


def headline(found: Evidence) -> str:
    """Return the verdict, with the digits and the sampling rate that it rests on."""
    verdict = str(found.verdict)
    if found.verdict == "cannot be told":
        return f"{verdict} from {_digits(found)}"
    return f"{verdict}, as far as {_digits(found)} can tell" if not found.conviction else verdict


def print_evidence(found: Evidence, execution: Execution) -> None:
    """Print the table of limits and the sentences below it."""
    table = console.table("limit", numbers=_COLUMNS)
    for name, told in found.limits.items():
        uses = "-" if told.uses is None else f"{told.uses:.4f}"
        window = f"{1e3 * told.window:.3g} ms" if np.isfinite(told.window) else "never"
        digits = f"{told.digits_alone:.2g}"
        if told.digits_alone >= 100:
            digits = f"{told.digits_alone:.0f}"
        table.row(
            KINDS[name].name(), f"{told.at_least:.4f}", uses, f"{told.spline:.4g}", digits, window
        )
    console.OUT.print(table)
    for sentence in _sentences(found, execution):
        console.paragraph(sentence)


def _sentences(found: Evidence, execution: Execution) -> Iterator[str]:
    within = "noise" if found.noise else "digits"
    if found.conviction is not None:
        yield (
            f"No motion within the {within} keeps the limits: "
            f"{_proved(found.conviction, execution)} (proved)."
        )
        if len(found.convictions) > 1:
            labels = execution.problem.joint_labels
            each = [
                f"{labels[own.joint]} {own.at_least:.4f}"
                for own in found.convictions
                if own.limit != "position"
            ]
            yield f"Times its limits, each joint that breaks some: {', '.join(each)}."
        if found.slower is not None:
            slower = found.slower
            yield (
                f"At their own spacing the samples take at least {slower.at_least:.4f} times as "
                f"long (proved). A motion keeps the limits in {slower.factor:.4f} times as long, "
                f"{slower.motion.duration:.6f} s."
            )
        if found.by_positions not in (None, "broken"):
            yield (
                "The velocities are part of the proof: by the positions alone the verdict is "
                f"'{found.by_positions}'. Velocities that were measured or filtered apart from the "
                "positions prove nothing; --interpolation spline leaves them out."
            )
    elif found.motion is None:
        yield f"No motion within the {within} was found, and no proof that there is none."
    elif execution.certificate.dilation > 1.001:
        yield (
            f"The best motion that was found within the {within} breaks a limit, and there is no "
            "proof that every motion does."
        )
    else:
        yield f"A motion within the {within} keeps the limits. {_hidden(found)}"
    if found.misfit is not None:
        label = execution.problem.joint_labels[found.misfit.joint]
        yield (
            f"The velocities are left out: with them {label} would need "
            f"{found.misfit.at_least:.4g} times its limits, by its positions it does not. They "
            "are not the positions' own."
        )
    step = 2 * np.median(found.log.half_digits, axis=0)
    coarse = np.flatnonzero(step > 2 * 10.0 ** -np.array(found.log.decimals, dtype=float))
    if len(coarse):
        joint = int(coarse[np.argmax(step[coarse])])
        unit = execution.problem.unit(joint)
        yield (
            f"{execution.problem.joint_labels[joint]} comes in steps of {step[joint]:.2g} {unit}, "
            "coarser than its digits: the steps count."
        )
    if found.log.time_half_digit:
        yield (
            f"The times are rounded: each sample may be {found.log.time_half_digit:.2g} s earlier "
            "or later."
        )
    if found.noise:
        yield (
            f"The verdict is statistical: independent normal noise of {found.noise:g} convicts "
            f"{NOISE_DOUBT * 100:g} % of lawful logs."
        )
        if found.log.velocities is not None:
            yield "The velocities are left out: their noise is not known."
    if found.motion is not None and not found.at_rest:
        judged = "Its exact peaks were judged, without repair."
        if not execution.problem.route.at_rest:
            judged = "Its motion was verified between the velocities that it has there."
        yield f"The log is cut: no motion within it rests at both ends. {judged}"
    if execution.motion.interpolation in ("cubic", "quintic"):
        kind = execution.motion.interpolation
        yield f"--interpolation {kind} judges the file as a controller executes it."


def _hidden(found: Evidence) -> str:
    """Say over which times an excess is not excluded."""
    longest = max(found.limits, key=lambda name: found.limits[name].window)
    window, name = found.limits[longest].window, KINDS[longest].name()
    if window <= found.window:
        return f"An excess of {_SHOWN} over {found.window:g} s would have shown."
    if not np.isfinite(window):
        return f"But an excess of {_SHOWN} of the {name} limit would never show."
    return (
        f"But an excess of {_SHOWN} of the {name} limit could hide for {window:.3g} s: with "
        f"--window {np.ceil(1e3 * window) / 1e3:g} it counts as kept, and more decimals tell more."
    )


def _proved(conviction: Conviction, execution: Execution) -> str:
    problem = execution.problem
    joint = problem.joint_labels[conviction.joint]
    if conviction.limit == "position":
        unit = problem.unit(conviction.joint)
        excess = f"{conviction.at_least:.4g} {unit} beyond its position limits"
        return f"{joint} is at least {excess} at {conviction.start:.6g} s"
    limits = f"{KINDS[conviction.limit].name()} limit" if conviction.limit else "limits together"
    when = f"between {conviction.start:.6g} and {conviction.end:.6g} s"
    if conviction.start == conviction.end:
        when = f"at {conviction.start:.6g} s"
    return f"{joint} needs at least {conviction.at_least:.4f} times its {limits} {when}"


def _digits(found: Evidence) -> str:
    low, high = min(found.log.decimals), max(found.log.decimals)
    count = f"{low}" if low == high else f"{low} to {high}"
    rate = 1 / float(np.median(np.diff(found.log.times)))
    return f"{count} decimal{'' if count == '1' else 's'} at {rate:.4g} Hz"
