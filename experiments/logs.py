"""Is the verdict on a log ever false?

    python -m experiments.logs                # 400 logs of seven joints, three minutes on one core
    python -m experiments.logs --quick        # 20 logs

Seven joints, limits of 2 rad/s, 10 rad/s² and, in half of the logs, 100 rad/s³. Lawful motions are
trains of moves at 1, 0.96, 0.69 or 0.36 of the limits. In broken ones a joint exceeds one limit by
5, 20 or 100 %, for 10 or 50 ms, in one of the moves. Both are exact: the highest derivative is
constant by pieces. The log has 100 to 1000 samples a second from a random instant on, 3 to 6
decimals, exact or rounded stamps, velocities with as many decimals or none, noise or none, and is
cut at both ends or not.

A verdict is false if it is `broken` for a lawful motion, or `kept` for a broken one whose excess
lasts for the window. If the excess is shorter than the window, `kept` is not false.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd

from experiments.common.output import progress, save_table
from trajopt.core.arrays import Array
from trajopt.core.limits import Limits
from trajopt.judging.evidence import evidence
from trajopt.judging.log_joint import Log

V, A, J = 2.0, 10.0, 100.0
SHARES = (1.0, 0.96, 0.69, 0.36)
EXCESSES = (0.05, 0.2, 1.0)
LENGTHS = (0.01, 0.05)  # s
RATES = (100, 125, 500, 1000)  # Hz
DECIMALS = (3, 4, 5, 6)
NOISES = (0.0, 0.0, 0.0, 1e-5, 1e-4)  # rad
WINDOWS = {"kept, 10 ms": 0.01, "kept, 50 ms": 0.05, "kept, 100 ms": 0.1}  # s
JOINTS = 7
MOVES = 4

Generator = np.random.Generator
Phases = list[tuple[float, float]]
"""Lengths, s, and values of the highest derivative."""


@dataclass(frozen=True)
class Truth:
    """A motion whose highest derivative is constant by pieces, from rest at 0.

    Attributes:
        phases: In order.
        order: Of the highest derivative, 2 or 3.
    """

    phases: Phases
    order: int

    @property
    def duration(self) -> float:
        return float(sum(length for length, _ in self.phases))

    def __call__(self, t: Array, order: int = 0) -> Array:
        """Positions, rad, at times t, s; of order 1, velocities. It rests before and after."""
        t = np.clip(t, 0, self.duration)
        starts = np.cumsum([0.0, *(length for length, _ in self.phases)])
        states = [np.zeros(self.order)]  # position, velocity and perhaps acceleration
        for length, value in self.phases:
            states.append(self._after(states[-1], length, value))
        piece = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(self.phases) - 1)
        found = np.zeros(len(t))
        for index in np.unique(piece):
            inside = piece == index
            value = self.phases[index][1]
            found[inside] = self._after(states[index], t[inside] - starts[index], value)[order]
        return found

    def _after(self, state: Array, h: float | Array, value: float) -> Array:
        whole = [*state, value]
        after = []
        for first in range(self.order):
            sum_ = np.zeros_like(h)
            factor = 1.0
            for power, derivative in enumerate(whole[first:]):
                factor = factor * power if power else 1.0
                sum_ = sum_ + derivative * np.asarray(h) ** power / factor
            after.append(sum_)
        return np.array(after, dtype=float)


def move(rng: Generator, order: int, v: float, a: float, j: float, plateau: float = 0.0) -> Phases:
    """A move at limits v, a, j: up to speed, cruise for at least `plateau`, and down again."""
    sign = rng.choice([-1.0, 1.0])
    cruise = max(plateau, rng.uniform(0.0, 0.2))
    speed = v * (1.0 if plateau else rng.uniform(0.2, 1.0))
    if order == 2:
        up = [(speed / a, a)]
    else:
        a = min(a, np.sqrt(speed * j))
        up = [(a / j, j), (speed / a - a / j, 0.0), (a / j, -j)]
    down = [(length, -value) for length, value in up]
    phases = [*up, (cruise, 0.0), *down]
    return [(length, sign * value) for length, value in phases if length > 0]


def exceeding(rng: Generator, order: int, kind: str, excess: float, length: float) -> Phases:
    """A move that exceeds one limit by this share for this long, and keeps the others."""
    if kind == "velocity":
        return move(rng, order, V * (1 + excess), A, J, plateau=length)
    high = {"acceleration": A, "jerk": J}[kind]
    if order == 3 and kind == "acceleration":
        a = A * (1 + excess)
        sign = rng.choice([-1.0, 1.0])
        up = [(a / J, J), (length, 0.0), (a / J, -J)]
        whole = [*up, (0.1, 0.0), *((own, -value) for own, value in up)]
        return [(own, sign * value) for own, value in whole]
    # The highest derivative: part of a phase has a larger value, and the phase is shorter.
    found: Phases = []
    done = False
    for own, value in move(rng, order, V, A, J, plateau=0.05):
        if not done and abs(value) == high and own > length * (1 + excess):
            found += [(length, value * (1 + excess)), (own - length * (1 + excess), value)]
            done = True
        else:
            found.append((own, value))
    return found if done else exceeding(rng, order, "velocity", excess, length)


@dataclass(frozen=True)
class Case:
    """A log with its truth.

    Attributes:
        log, limits: What is judged.
        share: Of the limits, which a lawful motion uses; NaN for a broken one.
        excess, length: By what share one limit is exceeded, and how long, s; 0 for a lawful one.
        rate: Hz.
        noise: rad.
    """

    log: Log
    limits: Limits
    share: float
    excess: float
    length: float
    rate: int
    noise: float

    @property
    def lawful(self) -> bool:
        return self.excess == 0


def case(rng: Generator, joints: int = JOINTS) -> Case:
    """Draw a log."""
    order = int(rng.choice([2, 3]))
    share, excess, length = float(rng.choice(SHARES)), 0.0, 0.0
    moves = [
        [move(rng, order, share * V, share * A, share * J) for _ in range(MOVES)]
        for _ in range(joints)
    ]
    if rng.uniform() < 0.5:
        kind = str(rng.choice(["velocity", "acceleration", "jerk"][:order]))
        share, excess, length = np.nan, float(rng.choice(EXCESSES)), float(rng.choice(LENGTHS))
        broken = exceeding(rng, order, kind, excess, length)
        moves[int(rng.integers(joints))][int(rng.integers(MOVES))] = broken
    truths = [Truth([phase for own in joint for phase in own], order) for joint in moves]
    rate = int(rng.choice(RATES))
    decimals = int(rng.choice(DECIMALS))
    noise = float(rng.choice(NOISES))
    first = rng.uniform(0.0, 1 / rate)
    last = max(truth.duration for truth in truths)
    if rng.uniform() < 0.5:
        first += rng.uniform(0.05, 0.2)
        last -= rng.uniform(0.05, 0.2)
    t = np.arange(first, last, 1 / rate)
    shift = 0.0
    stamps = t
    if rng.uniform() < 0.2:  # jitter, and stamps of a tenth of a step
        shift = 0.05 / rate
        t = t + rng.uniform(-0.3, 0.3, len(t)) / rate
        stamps = np.round(t / (2 * shift)) * 2 * shift
    positions = np.stack([truth(t) for truth in truths], axis=1)
    positions += rng.normal(0, 1, positions.shape) * noise
    velocities = None
    if rng.uniform() < 0.3:
        velocities = np.round([truth(t, 1) for truth in truths], decimals).T
    half = np.full(positions.shape, 0.5 * 10.0**-decimals)
    log = Log(
        stamps - stamps[0],
        np.round(positions, decimals),
        half,
        2 * shift,
        [decimals] * joints,
        velocities,
        half,
    )
    each = np.ones(joints)
    limits = Limits(V * each, A * each, J * each if order == 3 else None)
    return Case(log, limits, share, excess, length, rate, noise)


def counted(cases: int, seed: int, joints: int = JOINTS) -> pd.DataFrame:
    """Judge logs; a row of each has its truth, and `kept` within each window."""
    rows = []
    with progress(cases, "logs") as advance:
        for number in range(cases):
            own = case(np.random.default_rng([seed, number]), joints)
            found = evidence(own.log, own.limits, window=np.inf)
            shown = max(told.window for told in found.limits.values())
            rows.append(
                {
                    "lawful": own.lawful,
                    "share": own.share,
                    "excess": own.excess,
                    "length": own.length,
                    "decimals": own.log.decimals[0],
                    "rate": own.rate,
                    "noise": own.noise,
                    "velocities": own.log.velocities is not None,
                    "broken": found.verdict == "broken",
                    "raw": max(told.spline for told in found.limits.values()) > 1,
                    **{
                        name: found.verdict == "kept" and shown <= window
                        for name, window in WINDOWS.items()
                    },
                }
            )
            advance(1)
    return pd.DataFrame(rows)


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """A row for each kind of log: how many, their verdicts, and what the raw spline says."""
    lawful, broken = rows[rows["lawful"]], rows[~rows["lawful"]]
    parts = [("lawful", lawful)]
    parts += [(f"lawful, at {key:g} of the limits", own) for key, own in lawful.groupby("share")]
    parts += [("broken", broken)]
    for (excess, length), own in broken.groupby(["excess", "length"]):
        parts.append((f"broken, by {100 * excess:g} % for {1000 * length:g} ms", own))
    for truth, own in (("lawful", lawful), ("broken", broken)):
        parts += [(f"{truth}, {key} decimals", part) for key, part in own.groupby("decimals")]
        parts += [(f"{truth}, {key} Hz", part) for key, part in own.groupby("rate")]
        for key, part in own.groupby("noise"):
            parts.append((f"{truth}, noise of {key:g} rad" if key else f"{truth}, no noise", part))
        for known, part in own.groupby("velocities"):
            parts.append((f"{truth}, {'with' if known else 'without'} velocities", part))
    found = []
    for name, own in parts:
        kept = {name: int(own[name].sum()) for name in WINDOWS}
        untold = len(own) - int((own["broken"] | own[list(WINDOWS)].any(axis=1)).sum())
        found.append(
            {
                "logs of": name,
                "number": len(own),
                "broken": int(own["broken"].sum()),
                **kept,
                "cannot be told": untold,
                "the raw spline breaks a limit": int(own["raw"].sum()),
            }
        )
    return pd.DataFrame(found)


def false_verdicts(rows: pd.DataFrame) -> tuple[int, int]:
    """How many lawful logs are called broken; how many are kept though their excess would show."""
    hidden = [
        (rows["excess"] > 0) & (rows["length"] >= window) & rows[name]
        for name, window in WINDOWS.items()
    ]
    return int((rows["lawful"] & rows["broken"]).sum()), int(np.any(hidden, axis=0).sum())


def main(
    count: int = 400, seed: int = 1, output: Path = Path("results/logs"), quick: bool = False
) -> int:
    """Judge random logs of known truth.

    Args:
        count: How many logs; `quick`: 20.
        seed: Of the logs.
        output: Folder of the table.
        quick: Fewer logs.
    """
    rows = counted(20 if quick else count, seed)
    found = table(rows)
    save_table(found, output / "logs.csv")
    print(found.to_string(index=False))
    convicted, hidden = false_verdicts(rows)
    print(f"{convicted} of {int(rows['lawful'].sum())} lawful logs are called broken")
    print(f"{hidden} logs are kept with a window within which their excess of 5 % would show")
    return 1 if convicted else 0


if __name__ == "__main__":
    cyclopts.run(main)
