"""What does each supplier of guesses and each special treatment of `exact` and `exact-jerk` earn?

    python -m experiments.exact_ablation              # 30 motions and their parts, half an hour
    python -m experiments.exact_ablation --planner exact-jerk --motions 0 --every 5 --seconds 10

The problems are those of the suite `mixes`, parts of the motions of its drawn ones, cut in their
own state at random and a millisecond from both ends, and some of `moving` and `demands`. Each row
leaves one thing out, or halves or doubles a constant. It counts the problems whose certified
duration is longer by 1e-6 than the shortest of all rows and parts, and the CPU time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest.mock import patch

import cyclopts
import numpy as np
import pandas as pd

from baselines.exact.method import free_pieces
from experiments.common.output import save_table, say
from trajopt.benchmark.suites import catalogue, mixes
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import verify
from trajopt.planners.registry import load

LONGER = 1e-6  # relative
CYCLE_S = 1e-3
EVERY = 12  # problem of the suites `moving` and `demands`
_METHOD, _WITHOUT_JERK, _JERK = (
    f"baselines.exact.{own}" for own in ("method", "acceleration", "jerk")
)

Variant = Mapping[str, Callable[[Any], Any]]  # by module and attribute: the new value from the old


def _nothing(*_: Any, **__: Any) -> Any:
    return []


def _none(*_: Any, **__: Any) -> None:
    return None


def _out(place: str, instead: Callable[..., Any] = _nothing) -> Variant:
    return {place: lambda _: instead}


def _scaled(name: str, place: str) -> dict[str, Variant]:
    def times(factor: float) -> Callable[[Any], Any]:
        def one(old: float) -> float:
            return type(old)(max(1, old * factor) if isinstance(old, int) else old * factor)

        return lambda old: one(old) if np.ndim(old) == 0 else tuple(map(one, old))

    return {f"{name}, {word}": {place: times(k)} for word, k in (("halved", 0.5), ("doubled", 2.0))}


BOTH: dict[str, Variant] = {
    "all": {},
    "no motion of one piece": _out(f"{_METHOD}.one_piece:motion", _none),
    "no second method": _out(f"{_METHOD}.bounds:is_near", lambda *_: True),
    "no last iterates": _out(f"{_METHOD}.planner:unconverged", _none),
    "no easier problems after the gate": _out(f"{_METHOD}.gate:_easier"),
    "no merged neighbours": {
        f"{_WITHOUT_JERK}.boxes:merged": lambda merged: lambda own: iter([next(merged(own))])
    },
    "no pairs of merged neighbours": {f"{_WITHOUT_JERK}.boxes:MAX_PAIRS": lambda _: 0},
}
VARIANTS: dict[str, dict[str, Variant]] = {
    "exact": {
        **BOTH,
        "no first time of one segment": _out(f"{_WITHOUT_JERK}.planner:_of_one_segment", _none),
        "no guesses beside gaps": _out(f"{_WITHOUT_JERK}.gaps:starts"),
        "no instants before gaps": _out(f"{_WITHOUT_JERK}.planner:_before_gaps"),
        "no sharpened instants": _out(
            f"{_WITHOUT_JERK}.instants:sharpened", lambda _, times, states: (times, states)
        ),
        "no guesses at cruising speed": _out(f"{_METHOD}.guesses:cruising"),
        "no guesses on purpose": _out(f"{_METHOD}.guesses:on_purpose"),
        "no random guesses": {
            f"{_WITHOUT_JERK}.planner:starting_points": lambda old: lambda own, _: old(own, 1)
        },
        **_scaled("share of cruising speed", f"{_METHOD}.guesses:_CRUISING"),
        **_scaled("sweeps towards the chord", f"{_METHOD}.guesses:_SWEEPS"),
        **_scaled("guesses of every side", f"{_METHOD}.guesses:EVERY_SIDE"),
        **_scaled("width before gaps", f"{_WITHOUT_JERK}.planner:_WIDER"),
    },
    "exact-jerk": {
        **BOTH,
        "no guesses beside gaps": _out(f"{_JERK}.gaps:starts"),
        "no more guesses where all fail": _out(f"{_JERK}.gaps:more_starts", lambda _: iter(())),
        "no start at the exact points": _out(f"{_JERK}.planner:_from_exact_points"),
        **_scaled("pieces of the second method", f"{_METHOD}.free_pieces:PIECES"),
        **_scaled("cost of missing a waypoint", f"{_METHOD}.free_pieces:_MISS_COST"),
    },
}


def problems(planner: str, motions: int, every: int = EVERY) -> Iterator[tuple[Problem, float]]:
    """Yield problems, and durations that are possible, s (infinite where none is known)."""
    jerk = planner == "exact-jerk"
    for name in ("moving", "demands"):
        chosen = [own for own in catalogue.problems(name) if own.has("jerk") is jerk]
        yield from ((own, np.inf) for own in chosen[::every])
    parts = [own for own in catalogue.problems("mixes") if own.name.startswith("mixes-part")]
    yield from ((own, np.inf) for own in parts if own.has("jerk") is jerk)
    for index in range(int(jerk), 2 * motions, 2):
        drawn = mixes.draw(index)
        yield drawn, np.inf
        whole = replace(drawn, demands=mixes.inherited(drawn))
        motion = load(planner).solve(whole).trajectory
        if motion is None or not verify(whole, motion).dilation <= 1 + LONGER:
            continue
        rng = np.random.default_rng([62, index])
        at_random = np.round(rng.uniform(0.02, 0.98, 2) * motion.duration / CYCLE_S) * CYCLE_S
        for cut in (*at_random.tolist(), CYCLE_S, motion.duration - CYCLE_S):
            try:
                halves = mixes.halves(whole, motion, cut)
            except InvalidInput:  # a part that stands still is no problem
                continue
            yield from zip(halves, (cut, motion.duration - cut), strict=True)


def durations(planner: str, asked: list[tuple[Problem, float]], variant: Variant) -> Any:
    """Return the certified durations under a variant, and the CPU times, s."""
    free_pieces._solver.cache_clear()  # it is built with the constants of a row
    with ExitStack() as changed:
        for place, value in variant.items():
            module, _, attribute = place.partition(":")
            own = import_module(module)
            changed.enter_context(patch.object(own, attribute, value(getattr(own, attribute))))
        answers = [timed(planner, problem) for problem, _ in asked]
    motions, spent = zip(*answers, strict=True)
    pairs = zip(asked, motions, strict=True)
    found = [own and verify(problem, own).certified_duration for (problem, _), own in pairs]
    return np.array([own or np.inf for own in found]), np.array(spent)


def timed(planner: str, problem: Problem) -> tuple[Trajectory | None, float]:
    """Return a planner's motion and its CPU time, s."""
    began = time.process_time()
    motion = load(planner).solve(problem).trajectory
    return motion, time.process_time() - began


def main(
    planner: str = "exact",
    motions: int = 30,
    every: int = EVERY,
    seconds: float = np.inf,
    output: Path = Path("results"),
    quick: bool = False,
) -> None:
    """Write a row per variant.

    Args:
        planner: `exact` or `exact-jerk`.
        motions: How many drawn problems' motions are cut.
        every: Which problems of `moving` and `demands` count: 2 for every other one.
        seconds: CPU time; problems that take longer count in no row.
        output: Folder of the table.
        quick: Two motions.
    """
    asked = list(problems(planner, 2 if quick else motions, every))
    whole, spent = durations(planner, asked, {})
    quickly = spent <= seconds
    asked = [own for own, is_quick in zip(asked, quickly, strict=True) if is_quick]
    say(f"{len(asked)} problems; {(~quickly).sum()} that take longer do not count")
    rows = {"all": (whole[quickly], spent[quickly])}
    for name, variant in VARIANTS[planner].items():
        if name != "all":
            rows[name] = durations(planner, asked, variant)
        say(f"{name}: {rows[name][1].sum():.1f} s")
    known = [duration for _, duration in asked]
    shortest = np.min([known, *(own for own, _ in rows.values())], axis=0)
    table = [
        {
            "without": name,
            "longer": int((excess > LONGER).sum()),
            "no answer": int(np.isinf(excess).sum()),
            "longer at worst, %": 100 * max(excess[np.isfinite(excess)], default=0.0),
            "where": asked[excess.argmax()][0].name if excess.max() > LONGER else None,
            "CPU time": cpu.sum() / rows["all"][1].sum(),
        }
        for name, (own, cpu) in rows.items()
        for excess in [own / shortest - 1]
    ]
    save_table(pd.DataFrame(table), output / f"{planner}-ablation")


if __name__ == "__main__":
    cyclopts.run(main)
