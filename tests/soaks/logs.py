"""Is a lawful log ever convicted, whatever its sensors are?

    python tests/soak.py logs            # 4,000 logs, six minutes on one core
    python tests/soak.py logs --quick    # 60 logs
    python tests/soak.py logs --count 2300 --kind encoder --truth lawful

One joint with limits of 2 rad/s, 5 rad/s² and, in half of the logs, 100 rad/s³ makes two moves,
with pauses or none, as S-curves or bang-bang motions. A lawful one uses 0.9 or 0.999 of every
limit; a broken one exceeds one of them by 5, 20 or 100 %. What the log has of it:

- half of the logs are of encoders: 11 to 20 bits a turn behind a gear, noise of 0 to 5 steps, 50 to
  1000 samples a second, printed in rad or degrees with 3 to 8 decimals, all digits, or as 32-bit
  floats. Velocities are missing, true, noisy, differences of the positions, or filtered;
- the others have one peculiarity each, `PECULIAR`.

The verdict is that of `trajopt.judging.evidence`, without any hint. An oracle judges the same
samples with their true step, digits and noise: what it finds broken may be found. Of each log the
numbers of table, sentence, list of joints and JSON are compared. The exit code is 1 if more than
one of a thousand lawful logs of encoders is convicted, or more than 1 % of a peculiar kind and at
least two, or if a number differs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import tau
from pathlib import Path
from statistics import NormalDist
from typing import Literal

import numpy as np
import pandas as pd

from experiments.common.output import progress, save_table, say
from experiments.logs import Phases, Truth
from trajopt.core.arrays import Array
from trajopt.core.limits import Limits
from trajopt.formats.digits import half_digits
from trajopt.judging.evidence import KEPT_RTOL, Evidence, evidence
from trajopt.judging.log_joint import Log
from trajopt.judging.turns import unwrapped

V, A, J = 2.0, 5.0, 100.0
RATES = (50, 125, 250, 500, 1000)  # Hz
PRINTS = ("%.3f", "%.4f", "%.5f", "%.6f", "%.8f", "%r", "32 bits")
NOISES = (0.0, 0.0, 0.1, 0.3, 1.0, 5.0)  # steps
EXCESSES = (1.05, 1.2, 2.0)
VELOCITIES = ("", "", "", "true", "noisy", "derived", "filtered")
VELOCITY_NOISE = 3e-3  # rad/s
FILTER_S = 0.005
DOUBT = 1e-3  # of the oracle's noise

Generator = np.random.Generator


@dataclass(frozen=True)
class Case:
    """A log with its truth.

    Attributes:
        kind: `encoder`, or its peculiarity.
        log, limits: What is judged.
        exceeds: The limit that is exceeded; empty for a lawful one.
        known: The half width to which positions are truly known, rad; None where that is no number.
        labels: What it was drawn of.
    """

    kind: str
    log: Log
    limits: Limits
    exceeds: str
    known: float | None
    labels: dict[str, object]


def s_curve(v: float, a: float, j: float, cruise: float) -> Phases:
    """Phases of jerk from rest to rest with these peaks, of the acceleration if v allows."""
    ramp = min(a / j, np.sqrt(v / j))
    hold = max(0.0, v / a - a / j)
    up = [(ramp, j), (hold, 0.0), (ramp, -j)]
    return [*up, (cruise, 0.0), *((length, -value) for length, value in up)]


def motion(rng: Generator, order: int, exceeds: str) -> Truth:
    """Return two moves, forth and back, at a share of every limit; of one more than the limit."""
    share = float(rng.choice([0.9, 0.999]))
    peaks = {"velocity": share * V, "acceleration": share * A, "jerk": share * J}
    if exceeds:
        peaks[exceeds] *= float(rng.choice(EXCESSES)) / share
    v, a, j = peaks.values()
    pause = float(rng.choice([0.0, 0.1, 0.4]))
    phases: Phases = []
    for sign in (1, -1):
        cruise = rng.uniform(0.05, 0.4)
        own = s_curve(v, a, j, cruise) if order == 3 else [(v / a, a), (cruise, 0.0), (v / a, -a)]
        phases += [(pause, 0.0), *((length, sign * value) for length, value in own)]
    return Truth([own for own in [*phases, (pause, 0.0)] if own[0] > 0], order)


def printed(values: Array, form: str, degrees: bool) -> tuple[Array, Array, int]:
    """Return values as they are read back from a text, half their digits, and the decimals."""
    unit = np.pi / 180 if degrees else 1.0
    shown = values / unit
    if form == "32 bits":
        shown, form = shown.astype(np.float32).astype(float), "%r"
    texts = [form % own for own in shown.tolist()]
    read = np.array([float(text) for text in texts])
    half, decimals = half_digits(texts, read)
    return read * unit, half * unit, decimals


def encoder(rng: Generator, truth: Truth, labels: dict[str, object]) -> tuple[Log, float]:
    """Return the log of an encoder, and the half width to which its positions are known."""
    bits, noise = int(rng.integers(11, 21)), float(rng.choice(NOISES))
    rate, form = int(rng.choice(RATES)), str(rng.choice(PRINTS))
    degrees, kind = bool(rng.random() < 0.3), str(rng.choice(VELOCITIES))
    step = tau / 2**bits * float(rng.choice([1.0, 1.0, 0.81, 1 / 1.37]))
    labels |= {"rate": rate, "noise": noise, "form": form, "velocities": kind}
    t, at = stamps(rng, truth, rate)
    counted = (truth(at) + rng.normal(0, noise * step, len(t))) / step
    read = step * np.round(counted + rng.uniform()) + rng.uniform(-1, 1)
    x, half, decimals = printed(read, form, degrees)
    rates = speeds(rng, kind, truth(at, 1), read, rate)
    velocities = None if rates is None else printed(rates, form, degrees)
    unit = 2 * float(np.median(half))
    if form == "32 bits":
        unit = float(np.spacing(np.float32(np.abs(x).max())))
    known = (step + unit) / 2 + quantile(len(t)) * noise * step
    return log(t, x, half, decimals, velocities), known


def stamps(rng: Generator, truth: Truth, rate: float) -> tuple[Array, Array]:
    """Return even times from 0 on, and when the samples are taken since the motion begins."""
    first = rng.uniform(0, 1 / rate)
    t = np.arange(int((truth.duration + first) * rate) + 1) / rate
    return t, t - first


def speeds(rng: Generator, kind: str, true: Array, read: Array, rate: float) -> Array | None:
    """Return velocities of a kind, rad/s."""
    if not kind:
        return None
    if kind in ("true", "noisy"):
        return true + rng.normal(0, VELOCITY_NOISE, len(true)) * (kind == "noisy")
    derived = np.diff(read, prepend=read[0]) * rate
    if kind == "derived":
        return derived
    share = 1 - np.exp(-1 / (rate * FILTER_S))
    filtered = [derived[0]]
    for own in derived[1:]:
        filtered.append(filtered[-1] + share * (own - filtered[-1]))
    return np.array(filtered)


def log(
    t: Array, x: Array, half: Array, decimals: int, velocities: tuple[Array, Array, int] | None
) -> Log:
    known = Log(t, x[:, None], half[:, None], 0.0, [decimals])
    if velocities is None:
        return known
    v, e, _ = velocities
    return Log(t, x[:, None], half[:, None], 0.0, [decimals], v[:, None], e[:, None])


def quantile(samples: int) -> float:
    return NormalDist().inv_cdf(1 - DOUBT / (2 * samples))


# ---- peculiarities: from times since the start to what the file has ---------------------------

Peculiar = Callable[[Generator, Truth, int], tuple[Array, Array]]
"""Of a generator, a motion and a rate: the stamps, s, and the positions, rad."""


def _steps(rng: Generator, q: Array, bits: int | None = None) -> Array:
    step = tau / 2 ** (bits or int(rng.integers(13, 18)))
    return step * np.round(q / step + rng.uniform())


def _exact(rng: Generator, truth: Truth, rate: int) -> tuple[Array, Array]:
    t, at = stamps(rng, truth, rate)
    return t, truth(at)


def _coloured(rng: Generator, truth: Truth, rate: int) -> tuple[Array, Array]:
    """Noise of which each sample keeps 0.5 to 0.9 of the one before."""
    t, q = _exact(rng, truth, rate)
    kept, noise = rng.uniform(0.5, 0.9), rng.normal(0, 1e-4, len(t))
    for row in range(1, len(t)):
        noise[row] = kept * noise[row - 1] + np.sqrt(1 - kept**2) * noise[row]
    return t, _steps(rng, q + noise)


def _slow_sensor(rng: Generator, truth: Truth, rate: int) -> tuple[Array, Array]:
    """A sensor whose values repeat 2 to 5 times."""
    t, at = stamps(rng, truth, rate)
    times = int(rng.integers(2, 6))
    held = np.arange(len(t)) // times * times
    return t, _steps(rng, truth(at[held]))


def _uneven_sensor(rng: Generator, truth: Truth, rate: int) -> tuple[Array, Array]:
    """A sensor of a rate of its own, 0.3 to 0.6 of the log's."""
    t, at = stamps(rng, truth, rate)
    period = 1 / (rate * rng.uniform(0.3, 0.6))
    return t, _steps(rng, truth(np.floor(at / period) * period))


def _dropped(rng: Generator, truth: Truth, rate: int) -> tuple[Array, Array]:
    """One of 20 rows is missing, as the stamps say."""
    t, q = _exact(rng, truth, rate)
    kept = rng.random(len(t)) > 0.05
    kept[0] = True
    return t[kept] - t[kept][0], _steps(rng, q[kept])


def _lost(rng: Generator, truth: Truth, rate: int) -> tuple[Array, Array]:
    """One to three rows are missing, and the stamps do not say it."""
    t, q = _exact(rng, truth, rate)
    kept = np.ones(len(t), bool)
    kept[rng.integers(10, len(t) - 10, int(rng.integers(1, 4)))] = False
    return t[: kept.sum()], _steps(rng, q[kept])


def _jitter(rng: Generator, truth: Truth, rate: int) -> tuple[Array, Array]:
    """Samples are taken up to a tenth of a step from their stamps."""
    t, at = stamps(rng, truth, rate)
    return t, _steps(rng, truth(at + rng.normal(0, 0.03, len(t)) / rate))


def _truncated(rng: Generator, truth: Truth, rate: int) -> tuple[Array, Array]:
    """Values are cut, not rounded."""
    t, q = _exact(rng, truth, rate)
    step = tau / 2 ** int(rng.integers(13, 18))
    return t, step * np.floor(q / step)


def _unequal(rng: Generator, truth: Truth, rate: int) -> tuple[Array, Array]:
    """Steps of an encoder that differ by 10 %."""
    t, q = _exact(rng, truth, rate)
    step = tau / 2 ** int(rng.integers(13, 18))
    edges = np.cumsum(step * rng.uniform(0.9, 1.1, int(40 / step)))
    place = np.searchsorted(edges, q - q.min() + 1)
    return t, (edges[place] + edges[place - 1]) / 2


def _once_a_turn(rng: Generator, truth: Truth, rate: int) -> tuple[Array, Array]:
    """An encoder that is mounted off its axis: an error of 1e-3 rad, once a turn of the motor."""
    t, q = _exact(rng, truth, rate)
    return t, _steps(rng, q + 1e-5 * np.sin(50 * q))


def _cut(rng: Generator, truth: Truth, rate: int) -> tuple[Array, Array]:
    """It begins and ends in motion."""
    t, q = _exact(rng, truth, rate)
    n = len(t)
    part = slice(int(n * rng.uniform(0.05, 0.2)), int(n * rng.uniform(0.8, 0.95)))
    return t[part] - t[part][0], _steps(rng, q[part])


def _wrapped(rng: Generator, truth: Truth, rate: int) -> tuple[Array, Array]:
    """A continuous joint between -pi and pi."""
    t, q = _exact(rng, truth, rate)
    start = rng.uniform(-np.pi, np.pi)
    return t, (_steps(rng, q + start) + np.pi) % tau - np.pi


PECULIAR: dict[str, Peculiar] = {
    "exact": _exact,
    "coloured noise": _coloured,
    "a slower sensor": _slow_sensor,
    "a sensor of a rate of its own": _uneven_sensor,
    "dropped rows": _dropped,
    "lost rows": _lost,
    "jitter": _jitter,
    "truncated": _truncated,
    "unequal steps": _unequal,
    "an error once a turn": _once_a_turn,
    "cut": _cut,
    "whole turns": _wrapped,
}


def case(rng: Generator, kind: str) -> Case:
    """Draw a log of a kind, lawful or broken."""
    order = int(rng.choice([2, 3]))
    exceeds = ""
    if rng.random() < 0.5:
        exceeds = str(rng.choice(["velocity", "acceleration", "jerk"][:order]))
    limits = Limits([V], [A], [J] if order == 3 else None)
    truth = motion(rng, order, exceeds)
    labels: dict[str, object] = {}
    if kind == "encoder":
        own, known = encoder(rng, truth, labels)
        return Case(kind, own, limits, exceeds, known, labels)
    rate = int(rng.choice(RATES[1:]))
    t, q = PECULIAR[kind](rng, truth, rate)
    form = str(rng.choice(["%.5f", "%.6f", "%.8f", "%r"]))
    x, half, decimals = printed(q, form, degrees=False)
    straight, turns = unwrapped(t, x[:, None], half[:1], limits)
    own = Log(t, straight, half[:, None], 0.0, [decimals], turns=turns)
    return Case(kind, own, limits, exceeds, None, {"rate": rate, "form": form})


def oracle(own: Case) -> bool | None:
    """Return whether the log is broken by what its positions are truly known to."""
    if own.known is None:
        return None
    half = np.full(own.log.positions.shape, own.known)
    known = Log(own.log.times, own.log.positions, half, commanded=True)
    return evidence(known, own.limits).verdict == "broken"


def numbers_differ(found: Evidence) -> str:
    """Say which of two numbers for one thing differ; empty if none do."""
    for proof in found.convictions:
        if proof.limit in found.limits:
            told = found.limits[proof.limit]
            largest = max(own for own in told.by_joint if own is not None)
            if told.by_joint[proof.joint] != proof.at_least or told.at_least != largest:
                return f"{told} {proof}"
    shares = [told.at_least for told in found.limits.values()]
    by_one = any(proof.limit for proof in found.convictions)  # not by all limits together
    if (max(shares) > 1 + KEPT_RTOL) != by_one and found.verdict != "cannot be told":
        return f"{found.verdict} {shares}"
    table = found.as_dict()
    for name, told in found.limits.items():
        if table[name]["at_least"] != told.at_least:
            return name
    stated = [own["at_least"] for own in table["convictions"]]
    return "" if stated == [own.at_least for own in found.convictions] else "convictions"


def drawn(number: int, seed: int, kind: str = "") -> Case:
    """Return a log of a kind; by default half of them are encoders'."""
    kinds = list(PECULIAR)
    kind = kind or ("encoder" if number % 2 else kinds[number // 2 % len(kinds)])
    return case(np.random.default_rng([seed, number]), kind)


def judged(own: Case, number: int) -> dict[str, object]:
    """Return a row: the log's truth, and the verdict."""
    found = evidence(own.log, own.limits)
    return {
        "number": number,
        "kind": own.kind,
        "exceeds": own.exceeds,
        "verdict": found.verdict,
        "oracle": oracle(own) if own.exceeds else None,
        "differs": numbers_differ(found),
        **own.labels,
    }


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return counts of verdicts, of all encoders, by their properties, and of each kind."""
    encoders = rows[rows["kind"] == "encoder"]
    parts = [("encoders", encoders)]
    for name in ("noise", "rate", "form", "velocities"):
        for value, part in encoders.groupby(name) if len(encoders) else ():
            shown = f"{value:g}" if isinstance(value, float) else str(value) or "none"
            parts.append((f"encoders, {name}: {shown}", part))
    for limit in ("velocity", "acceleration", "jerk"):
        parts.append((f"encoders, {limit} exceeded", encoders[encoders["exceeds"] == limit]))
    parts += [(str(kind), part) for kind, part in rows[rows["kind"] != "encoder"].groupby("kind")]
    found = []
    for name, part in parts:
        lawful, broken = part[part["exceeds"] == ""], part[part["exceeds"] != ""]
        told = broken["verdict"] == "broken"
        may = broken["oracle"] == True  # noqa: E712 - None where there is no oracle
        found.append(
            {
                "logs of": name,
                "lawful": len(lawful),
                "convicted": int((lawful["verdict"] == "broken").sum()),
                "kept": int((lawful["verdict"] == "kept").sum()),
                "cannot be told": int((lawful["verdict"] == "cannot be told").sum()),
                "broken": len(broken),
                "found": int(told.sum()),
                "called kept": int((broken["verdict"] == "kept").sum()),
                "the oracle finds": int(may.sum()),
                "of these found": int((told & may).sum()),
            }
        )
    return pd.DataFrame(found)


def failures(counts: pd.DataFrame, rows: pd.DataFrame) -> list[str]:
    """Return what breaks the promise."""
    found = [f"log {own.number}: {own.differs}" for own in rows.itertuples() if own.differs]
    for own in counts.to_dict("records"):
        allowed = max(1, own["lawful"] // (1000 if own["logs of"] == "encoders" else 100))
        if own["convicted"] > allowed:
            found.append(f"{own['logs of']}: {own['convicted']} of {own['lawful']} convicted")
    return found


def main(
    count: int = 4000,
    seed: int = 1,
    kind: str = "",
    truth: Literal["", "lawful", "broken"] = "",
    output: Path = Path("results/logs"),
    quick: bool = False,
) -> int:
    """Judge logs of known truth.

    Args:
        count: How many are drawn; `quick`: 60.
        seed: Of the logs.
        kind: Only this one: encoder, or a peculiar one.
        truth: Only lawful ones, or broken ones; the others are drawn, and not judged.
        output: Folder of the table.
        quick: Fewer logs.
    """
    rows = []
    count = 60 if quick else count
    with progress(count, "logs") as advance:
        for number in range(count):
            own = drawn(number, seed, kind)
            if truth in ("", "broken" if own.exceeds else "lawful"):
                rows.append(judged(own, number))
            advance(1)
    frame = pd.DataFrame(rows)
    counts = table(frame)
    save_table(counts, output / "logs.csv")
    say(counts.to_string(index=False))
    wrong = failures(counts, frame)
    for sentence in wrong:
        say(sentence)
    return 1 if wrong else 0
