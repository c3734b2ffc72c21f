"""Is the verdict on a log ever false?

    python -m experiments.logs                # 3,000 logs, some ten minutes on one core
    python -m experiments.logs --quick        # 100 logs

One joint, limits of 2 rad/s, 10 rad/s² and, in half of the logs, 100 rad/s³. Lawful motions are
trains of moves at 1, 0.96, 0.69 or 0.36 of the limits. Broken ones exceed one limit by 5, 20 or
100 %, for 10 or 50 ms, in one of the moves. Both are exact: the highest derivative is constant by
pieces. The log has 100 to 1000 samples a second from a random instant on, 3 to 6 decimals, exact or
rounded stamps, noise or none, and is cut at both ends or not.

A false verdict is `broken` of a lawful motion. `kept` of a broken one is no false verdict where the
excess is shorter than the window of 0.1 s, and the table counts it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd

from experiments.common.output import save_table
from trajopt.core.arrays import Array
from trajopt.core.limits import Limits
from trajopt.judging.evidence import Log, evidence

V, A, J = 2.0, 10.0, 100.0
SHARES = (1.0, 0.96, 0.69, 0.36)
EXCESSES = (0.05, 0.2, 1.0)
LENGTHS = (0.01, 0.05)  # s
RATES = (100, 125, 500, 1000)  # Hz
DECIMALS = (3, 4, 5, 6)
NOISES = (0.0, 0.0, 0.0, 1e-5, 1e-4)  # rad
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

    def __call__(self, t: Array) -> Array:
        """Positions, rad, at times t, s."""
        starts = np.cumsum([0.0, *(length for length, _ in self.phases)])
        states = [np.zeros(self.order)]  # position, velocity and perhaps acceleration
        for length, value in self.phases:
            states.append(self._after(states[-1], length, value))
        piece = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(self.phases) - 1)
        found = np.zeros(len(t))
        for index in np.unique(piece):
            inside = piece == index
            value = self.phases[index][1]
            found[inside] = self._after(states[index], t[inside] - starts[index], value)[0]
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
    """A log with its truth."""

    log: Log
    limits: Limits
    lawful: bool
    what: str
    noise: float


def case(rng: Generator) -> Case:
    """Draw a log."""
    order = int(rng.choice([2, 3]))
    lawful = bool(rng.uniform() < 0.5)
    share = float(rng.choice(SHARES))
    what = f"at {share:g} of the limits"
    moves = [move(rng, order, share * V, share * A, share * J) for _ in range(MOVES)]
    if not lawful:
        kind = str(rng.choice(["velocity", "acceleration", "jerk"][:order]))
        excess, length = float(rng.choice(EXCESSES)), float(rng.choice(LENGTHS))
        moves[int(rng.integers(MOVES))] = exceeding(rng, order, kind, excess, length)
        what = f"{100 * excess:g} % for {1000 * length:g} ms"
    truth = Truth([phase for own in moves for phase in own], order)
    rate = int(rng.choice(RATES))
    decimals = int(rng.choice(DECIMALS))
    noise = float(rng.choice(NOISES))
    first = rng.uniform(0.0, 1 / rate)
    last = truth.duration
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
    q = np.round(truth(np.clip(t, 0, truth.duration)) + rng.normal(0, 1, len(t)) * noise, decimals)
    half = np.full((len(t), 1), 0.5 * 10.0**-decimals)
    log = Log(stamps - stamps[0], q[:, None], half, 2 * shift, [decimals])
    jerk = [J] if order == 3 else None
    return Case(log, Limits([V], [A], jerk), lawful, what, noise)


def counted(cases: int, seed: int) -> pd.DataFrame:
    """Judge logs, and count the verdicts by truth and decimals."""
    rows = []
    for number in range(cases):
        own = case(np.random.default_rng([seed, number]))
        found = evidence(own.log, own.limits, noise=own.noise)
        rows.append(
            {
                "truth": "lawful" if own.lawful else "broken",
                "what": own.what,
                "decimals": own.log.decimals[0],
                "verdict": found.verdict,
                "raw": max(told.spline for told in found.limits.values()) > 1,
            }
        )
    return pd.DataFrame(rows)


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """A row for each truth and kind: logs, verdicts, and what the raw spline says."""
    found = []
    for (truth, what), own in rows.groupby(["truth", "what"], sort=False):
        counts = own["verdict"].value_counts()
        found.append(
            {
                "truth": f"{truth}, {what}",
                "logs": len(own),
                **{name: int(counts.get(name, 0)) for name in ("broken", "kept", "cannot be told")},
                "the raw spline breaks a limit": int(own["raw"].sum()),
            }
        )
    return pd.DataFrame(found).sort_values("truth", ascending=False)


def main(
    count: int = 3000, seed: int = 1, output: Path = Path("results/logs"), quick: bool = False
) -> int:
    """Judge random logs of known truth.

    Args:
        count: How many logs; `quick`: 100.
        seed: Of the logs.
        output: Folder of the table.
        quick: Fewer logs.
    """
    rows = counted(100 if quick else count, seed)
    found = table(rows)
    save_table(found, output / "logs.csv")
    print(found.to_string(index=False))
    false = int(((rows["truth"] == "lawful") & (rows["verdict"] == "broken")).sum())
    print(f"{false} of {int((rows['truth'] == 'lawful').sum())} lawful logs are called broken")
    return 1 if false else 0


if __name__ == "__main__":
    cyclopts.run(main)
