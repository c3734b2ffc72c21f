"""Print the verdict on a log and what it rests on, for `verify` and `judge`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import log2, tau

import numpy as np

from trajopt.cli import console
from trajopt.core.limits import KINDS
from trajopt.judgement import Execution
from trajopt.judging.evidence import KEPT_RTOL, Conviction, Evidence
from trajopt.judging.log_windows import EXCESS
from trajopt.judging.premise import HIDDEN_NOISE, NOISE_DOUBT, Premise

_SHOWN = f"{100 * EXCESS:g} %"
_COLUMNS = ("at least", "motion uses", "raw spline", "widths alone", f"{_SHOWN} shows in")
_MOST_PREMISES = 3  # of more, only those with the widest and the narrowest widths are printed
_MOST_TIMES = 4
_DIFFERS = 1.1  # two readings that differ by a larger ratio get a line
_WHOLE_BITS = 1e-3
_COUNTS = ("no", "one", "two", "three", "four")


def headline(found: Evidence, execution: Execution) -> str:
    """Return the verdict, with the half widths and the sampling rate that it rests on."""
    verdict = str(found.verdict)
    if found.verdict == "cannot be told":
        return f"{verdict} from {_range(found, execution)}"
    return (
        verdict if found.conviction else f"{verdict}, as far as {_range(found, execution)} can tell"
    )


def print_evidence(found: Evidence, execution: Execution) -> None:
    """Print the premise, the table of limits and the sentences below it."""
    for sentence in _premises(found, execution):
        console.paragraph(sentence)
    table = console.table("limit", numbers=_COLUMNS)
    for name, told in found.limits.items():
        uses = "-" if told.uses is None else f"{told.uses:.4f}"
        window = f"{1e3 * told.window:.3g} ms" if np.isfinite(told.window) else "never"
        alone = f"{told.digits_alone:.2g}"
        if told.digits_alone >= 100:
            alone = f"{told.digits_alone:.0f}"
        table.row(
            KINDS[name].name(), f"{told.at_least:.4f}", uses, f"{told.spline:.4g}", alone, window
        )
    console.OUT.print(table)
    for sentence in _sentences(found, execution):
        console.paragraph(sentence)


# ---- the premise -----------------------------------------------------------------------------


def _premises(found: Evidence, execution: Execution) -> Iterator[str]:
    """Say how accurately positions are known: one sentence for all joints of one accuracy."""
    labels = execution.problem.joint_labels
    moving = [joint for joint, logged in enumerate(found.joints) if np.ptp(logged.positions) > 0]
    alike: dict[tuple[object, ...], list[int]] = {}
    for joint in moving or range(len(found.joints)):
        kind = (_kind(found.joints[joint].known), found.log.decimals[joint])
        alike.setdefault(kind, []).append(joint)
    groups = sorted(alike.values(), key=lambda joints: -found.joints[joints[0]].known.known)
    proof = found.conviction
    if proof is not None:  # its premise is always there
        groups.sort(key=lambda joints: proof.joint not in joints)
    for joints in groups[:_MOST_PREMISES]:
        names = "" if len(groups) == 1 else f"{', '.join(labels[joint] for joint in joints)}: "
        widest = max(joints, key=lambda joint: found.joints[joint].known.known)
        known, unit = found.joints[widest].known, execution.problem.unit(widest)
        yield f"{names}{premise(known, found.log.decimals[widest], unit, len(joints) > 1)}"
    if len(groups) > _MOST_PREMISES:
        rest = [joint for joints in groups[_MOST_PREMISES:] for joint in joints]
        names = ", ".join(labels[joint] for joint in rest)
        most = max(found.joints[joint].known.known for joint in rest)
        yield f"{names}: known to \N{PLUS-MINUS SIGN}{most:.2g} or better (--json has each)."
    for joint, rows in enumerate(found.log.turns):
        if rows:
            times = _times(found.log.times[rows])
            yield (
                f"{labels[joint]} has no position limits, so it is continuous: its steps of whole "
                f"turns after {times} s are no motion."
            )
    if found.lost:
        count = sum(loss.count for loss in found.lost)
        times = _times(found.joints[0].times[[loss.row for loss in found.lost]])
        which = "1 row seems" if count == 1 else f"{count} rows seem"
        yield (
            f"{which} to be missing, after {times} s, where times were written as if none was: the "
            "numbers below count the time of these rows."
        )


def _kind(known: Premise) -> tuple[object, ...]:
    """Return what is equal for joints of which one sentence tells."""
    found = (known.seen, bool(known.windows), bool(known.jitter), bool(known.left_out))
    return (f"{known.step:.3g}", known.commanded, *known.stated, *found)


def premise(known: Premise, decimals: int, unit: str, several: bool = False) -> str:
    """Say how accurately one joint's positions are known, and whether that was found or stated.

    Of several joints it is the one whose positions are known least accurately.
    """
    width = f"Positions are known to {_width(known)} {unit}{' or better' if several else ''}"
    digits = f"{decimals} decimal{'' if decimals == 1 else 's'}"
    if known.commanded:
        return f"{width}: they were sent, with {digits}."
    if known.step:
        rounding = f"a step of {known.step:.4g} {unit} in all {known.values} values"
        bits = log2(tau / known.step)
        if unit == "rad" and abs(bits - round(bits)) < _WHOLE_BITS:
            rounding += f" ({bits:.0f} bits a turn)"
        if "resolution" in known.stated:
            rounding = f"a step of {known.step:.4g} {unit} (as you said)"
    else:
        rounding = digits
    if "noise" in known.stated:
        noise = f"noise of {known.noise:.4g} {unit} (as you said)"
    elif known.seen:
        noise = f"noise of up to {known.noise:.2g} {unit} (found)"
    elif not known.windows:
        noise = "noise that cannot be told, for too few rows are in motion"
    elif known.step:
        noise = f"noise below {max(HIDDEN_NOISE, known.noise / known.step):.1g} steps (found)"
    else:
        noise = f"noise below {max(HIDDEN_NOISE * known.unit, known.noise):.1g} {unit} (found)"
    also = []
    if known.jitter:
        also.append(f"Its times scatter by {known.jitter:.2g} s.")
    if known.left_out:
        also.append(
            f"{known.left_out} of {known.left_out + len(known.times)} rows repeat an older value, "
            "of a slower sensor: they are left out."
        )
    return " ".join([f"{width}: {rounding} and {noise}.", *also])


def _width(known: Premise) -> str:
    return f"±{known.known:.2g}"


def _range(found: Evidence, execution: Execution) -> str:
    moving = [logged.known for logged in found.joints if np.ptp(logged.positions) > 0]
    widest = max(
        moving or [logged.known for logged in found.joints], key=lambda logged: logged.known
    )
    rate = 1 / float(np.median(np.diff(found.log.times)))
    return f"{_width(widest)} {execution.problem.shared_unit()} at {rate:.4g} Hz"


# ---- what follows from it --------------------------------------------------------------------


def _sentences(found: Evidence, execution: Execution) -> Iterator[str]:
    labels = execution.problem.joint_labels
    if found.conviction is not None:
        yield from _proved(found.conviction, found, execution)
        if len(found.convictions) > 1:
            each = [
                f"{labels[proof.joint]} {proof.at_least:.4f}"
                for proof in found.convictions
                if proof.limit != "position"
            ]
            yield f"Times its limits, each joint that breaks some: {', '.join(each)}."
        if found.by_positions not in (None, "broken"):
            yield (
                "The velocities are the proof: by the positions alone the verdict is "
                f"'{found.by_positions}'. --interpolation spline leaves velocities out."
            )
    elif found.motion is None:
        yield "No motion within these widths was found, and no proof that there is none."
    elif any(told.uses is not None and told.uses > 1 + KEPT_RTOL for told in found.limits.values()):
        yield (
            "The best motion that was found within these widths breaks a limit, and there is no "
            "proof that every motion does."
        )
    else:
        yield f"A motion within these widths keeps the limits. {_hidden(found)}"
    other = _otherwise(found)
    if other:
        yield other
    reasons = {logged.no_readings for logged in found.joints} - {""}
    for reason in sorted(reasons):
        joints = [
            labels[joint]
            for joint, logged in enumerate(found.joints)
            if logged.no_readings == reason
        ]
        which = "" if len(joints) == len(labels) else f" of {', '.join(joints)}"
        yield f"The velocities{which} are left out: {reason}."
    if found.log.time_half_digit:
        yield (
            f"The times are rounded: each sample may be {found.log.time_half_digit:.2g} s earlier "
            "or later."
        )
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
        f"--window {np.ceil(1e3 * window) / 1e3:g} it counts as kept, and positions that are known "
        "better tell more."
    )


def _proved(proved: Conviction, found: Evidence, execution: Execution) -> Iterator[str]:
    """Say what is proved under which premise, by which rows, and how far off that must be."""
    problem = execution.problem
    joint, unit = problem.joint_labels[proved.joint], problem.unit(proved.joint)
    known = found.joints[proved.joint].known
    if proved.of_velocities:
        premise = f"With velocities known to ±{proved.half.max():.2g} {unit}/s"
    else:
        premise = f"With positions known to {_width(known)} {unit}"
    chance = f", with noise that convicts {NOISE_DOUBT * 100:g} % of lawful logs"
    proof = "proved" + (chance if known.statistical and known.seen else "")
    if proved.limit == "position":
        yield (
            f"{premise}, {joint} is at least {proved.at_least:.4g} {unit} beyond its position "
            f"limits at {proved.start:.6g} s ({proof})."
        )
        return
    kind = KINDS[proved.limit].name() if proved.limit else ""
    if not len(proved.values):
        limits = f"{kind} limit" if kind else "limits together"
        yield (
            f"{premise}, {joint} needs at least {proved.at_least:.4f} times its {limits} between "
            f"{proved.start:.6g} and {proved.end:.6g} s ({proof}, by all rows between)."
        )
        return
    times = _times(proved.times)
    if len(proved.times) == 1:
        at_least = _times_limit(proved)
        yield f"{premise}, {joint}'s {kind} at {times} s is at least {at_least} ({proof})."
    else:
        count = _COUNTS[len(proved.times)]
        yield (
            f"{premise}, {joint}'s mean {kind} over the rows at {times} s is at least "
            f"{_times_limit(proved)} ({proof}; these {count} rows suffice)."
        )
    what = "velocities" if proved.of_velocities else "positions"
    if proved.margin > 1:
        yield f"Lawful only if {what} were off by at least {proved.margin:.3g} times as much."


def _times_limit(proved: Conviction) -> str:
    return f"{proved.at_least:.4f} times its limit"


def _otherwise(found: Evidence) -> str:
    """Say what the other reading of the positions proves, where that differs."""
    other = found.otherwise
    shown = max((told.at_least for told in found.limits.values()), default=0.0)
    broken, other_breaks = found.verdict == "broken", other > 1 + KEPT_RTOL
    if broken == other_breaks and not (broken and max(other / shown, shown / other) > _DIFFERS):
        return ""
    if found.log.commanded:
        verdict = f"at least {other:.3g} times" if other_breaks else "not broken"
        return f"As measured positions, whose noise is found: {verdict} (--measured)."
    verdict = f"at least {other:.3g} times" if other_breaks else "not broken"
    return f"As exact digits: {verdict} (--commanded)."


def _times(times: Sequence[float] | np.ndarray) -> str:
    """Return times, s, in a sentence; of many the first ones."""
    shown = [f"{time:.6g}" for time in list(times)[:_MOST_TIMES]]
    if len(times) > _MOST_TIMES:
        return f"{', '.join(shown)}, ..."
    return " and ".join([", ".join(shown[:-1]), shown[-1]]) if len(shown) > 1 else shown[0]
