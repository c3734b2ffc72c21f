"""What does each supplier of guesses and each special treatment of `exact` and `exact-jerk` earn?

    python -m experiments.exact_ablation              # 30 motions and their parts, half an hour
    python -m experiments.exact_ablation --planner exact-jerk --motions 0 --every 5 --seconds 10

The problems are those of the suite `mixes`, parts of the motions of its drawn ones, cut in their
own state at random and a millisecond from both ends, and some of `moving` and `demands`. Each row
leaves one thing out, or halves or doubles a constant. It counts the problems whose certified
duration is longer by 1e-6 than the shortest of all rows and parts, and the CPU time.

Each answer is written to `<planner>-ablation-answers.csv` when it is known, and the table after
each row. The same command goes on where it was stopped.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
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
Asked = tuple[Problem, float]  # with a duration that is possible, s; infinite where none is known


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


def problems(planner: str, motions: int, every: int = EVERY) -> Iterator[Asked]:
    """Yield problems."""
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


def answers(
    planner: str, asked: Sequence[Asked], name: str, variant: Variant, file: Path
) -> pd.DataFrame:
    """Return the answers under a variant, one a problem, with the columns of the file.

    Args:
        planner: Its name.
        asked: The problems.
        name: Of the variant.
        variant: What is changed.
        file: Has known answers; new ones are added.
    """
    known = pd.read_csv(file)
    known = known[known["without"] == name].set_index("problem")
    free_pieces._solver.cache_clear()  # it is built with the constants of a row
    with ExitStack() as changed:
        for place, value in variant.items():
            module, _, attribute = place.partition(":")
            own = import_module(module)
            changed.enter_context(patch.object(own, attribute, value(getattr(own, attribute))))
        for problem, _ in asked:
            if problem.name in known.index:
                continue
            motion, spent = timed(planner, problem)
            duration = motion and verify(problem, motion).certified_duration
            row = pd.DataFrame([[name, problem.name, duration or np.inf, spent]])
            row.to_csv(file, mode="a", header=False, index=False)
    return pd.read_csv(file).set_index(["without", "problem"]).loc[name]


def timed(planner: str, problem: Problem) -> tuple[Trajectory | None, float]:
    """Return a planner's motion and its CPU time, s."""
    began = time.process_time()
    motion = load(planner).solve(problem).trajectory
    return motion, time.process_time() - began


def table(asked: Sequence[Asked], rows: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Return a row per variant, each beside the shortest durations of all."""
    known = [duration for _, duration in asked]
    shortest = np.min([known, *(own["certified, s"] for own in rows.values())], axis=0)
    found = []
    for name, own in rows.items():
        excess = own["certified, s"].to_numpy() / shortest - 1
        found.append(
            {
                "without": name,
                "longer": int((excess > LONGER).sum()),
                "no answer": int(np.isinf(excess).sum()),
                "longer at worst, %": 100 * max(excess[np.isfinite(excess)], default=0.0),
                "where": asked[excess.argmax()][0].name if excess.max() > LONGER else None,
                "CPU time": own["CPU, s"].sum() / rows["all"]["CPU, s"].sum(),
            }
        )
    return pd.DataFrame(found)


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
    output.mkdir(parents=True, exist_ok=True)
    file = output / f"{planner}-ablation-answers.csv"
    if not file.exists():
        file.write_text('without,problem,"certified, s","CPU, s"\n')
    whole = answers(planner, asked, "all", {}, file)
    asked = [own for own in asked if whole["CPU, s"][own[0].name] <= seconds]
    say(f"{len(asked)} problems; {len(whole) - len(asked)} that take longer do not count")
    rows = {}
    for name, variant in VARIANTS[planner].items():
        found = answers(planner, asked, name, variant, file)
        rows[name] = found.loc[[problem.name for problem, _ in asked]]
        say(f"{name}: {rows[name]['CPU, s'].sum():.1f} s")
        save_table(table(asked, rows), output / f"{planner}-ablation")


if __name__ == "__main__":
    cyclopts.run(main)
