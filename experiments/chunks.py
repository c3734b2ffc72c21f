"""What is possible with the chunks of learned policies, and what is done with them today?

    python -m experiments.chunks            # 1,000 chunks, 40 beside rivals, bounds of 16: an hour
    python -m experiments.chunks --quick    # a few of each
    python -m experiments.chunks --draw chunks.png   # the figure of the page

50 targets of 7 joints at 30 Hz, 2 rad/s and 10 rad/s², within 5 mrad, of four kinds
(`trajopt.benchmark.suites.chunks`).

- answers: in batches of 25: certified, over the dilated spline, CPU s of a chunk;
- single: one call a chunk, CPU s;
- bounds: the answer over a proved bound (`ChunkAnswer.bound`), minus 1;
- steps: a chunk that takes over from one that runs, three tenths of it passed, with new noise of 5
  mrad and another anchor of 10 mrad: CPU s of a step;
- search: the answer over that of `exact`'s full search, from ten guesses to the last digit;
- jerk: the same chunks with jerk limits of 200 rad/s³, one call a chunk;
- quick: these with `QUICK`, without the full search;
- rivals: what is done today, at the chunk's own times and played as fast as the answer.

Rivals that send positions step by step are joined by lines, as a controller joins positions. Their
accelerations are second differences over two steps: no motion through these positions has less.
Deviation is the distance from each target at its time, ∫ jerk² that of third differences at the
rate of the targets, both of every row in the same way; a motion that passes its targets at other
times has its deviation when it passes them. Time is until the arm is within 5 mrad of the last
target for good.

Rows go to `chunks.csv` in `--output` as soon as they are known.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, Literal

import cyclopts
import numpy as np

from experiments.common.kept import kept
from experiments.common.output import save_table
from trajopt import Limits, Trajectory, verify
from trajopt.benchmark.suites.chunks import (
    ACCELERATION,
    JOINTS,
    KINDS,
    RATE,
    VELOCITY,
    targets,
)
from trajopt.chunks import TOLERANCE, Chunk, ChunkAnswer, answers, from_samples, take_over
from trajopt.core.arrays import Array
from trajopt.judging.verification import certified
from trajopt.planners.registry import load

JERK = 200.0
BATCH = 25
FILTER = 0.5  # share of the way to the target that the filter takes in a step
MOST_STEPS = 2000
PROOF_S = 30.0
KEY = ["question", "kind", "number"]
DRAWN, DRAWN_JOINT = 0, 5  # number of the noisy chunk in the figure, and its joint from 0


def chunk(kind: str, number: int, *, jerk: bool = False) -> Chunk:
    sizes = [VELOCITY, ACCELERATION, JERK][: 3 if jerk else 2]
    limits = Limits(*([size] * JOINTS for size in sizes))
    return from_samples(targets(kind, number), limits, rate=RATE, name=f"{kind}-{number}")


def answered(kind: str, number: int) -> Iterator[dict[str, Any]]:
    """Plan a batch of chunks together."""
    asked = [chunk(kind, BATCH * number + i) for i in range(BATCH)]
    began = time.process_time()
    found = answers(asked)
    seconds = (time.process_time() - began) / BATCH
    for answer in found:
        yield row("batch", answer, seconds)


def row(method: str, answer: ChunkAnswer, seconds: float) -> dict[str, Any]:
    duration, simple = answer.duration, answer.spline
    return {
        "method": method,
        "chunk": answer.chunk.problem.name,
        "duration": duration,
        "spline": simple,
        "planner": answer.trial.planner,
        "cpu": seconds,
    }


def alone(
    kind: str, number: int, *, jerk: bool = False, quick: bool = False
) -> Iterator[dict[str, Any]]:
    """Plan a chunk by itself."""
    asked = chunk(kind, number, jerk=jerk)
    began = time.process_time()
    (answer,) = answers([asked], quick=quick)
    name = ("quick" if quick else "jerk") if jerk else "single"
    yield row(name, answer, time.process_time() - began)


def bounds(kind: str, number: int) -> Iterator[dict[str, Any]]:
    """Prove a bound on the time of a chunk."""
    answer = chunk(kind, number).fastest()
    began = time.process_time()
    bound = answer.bound(PROOF_S)
    seconds = time.process_time() - began
    assert answer.duration is not None
    yield row("bound", answer, seconds) | {"bound": bound, "gap": answer.duration / bound - 1}


def stepped(kind: str, number: int) -> Iterator[dict[str, Any]]:
    """Let new targets take over from a motion that runs."""
    asked = chunk(kind, number)
    running = asked.fastest().motion
    assert running is not None
    at = 0.3 * running.duration
    ahead = asked.problem.waypoints[np.searchsorted(running.waypoint_times, at) + 1 :]
    rng = np.random.default_rng(number)
    moved = ahead + rng.normal(0, 0.005, ahead.shape) + rng.normal(0, 0.01, JOINTS)
    began = time.process_time()
    answer = take_over(running, at, moved, asked.problem.limits, rate=RATE)
    yield row("step", answer, time.process_time() - began)


def searched(kind: str, number: int) -> Iterator[dict[str, Any]]:
    """Search for a faster motion with all that `exact` has."""
    answer = chunk(kind, number).fastest()
    began = time.process_time()
    (full,) = answers([answer.chunk], planner="exact")
    seconds = time.process_time() - began
    assert answer.duration is not None
    assert full.duration is not None
    yield row("search", full, seconds) | {"gap": answer.duration / full.duration - 1}


def rivals(kind: str, number: int) -> Iterator[dict[str, Any]]:
    """Execute a chunk as it is done today, and as it is possible."""
    asked = chunk(kind, number)
    answer = asked.fastest()
    assert answer.motion is not None
    assert answer.duration is not None
    yield measured("this toolkit, fastest", asked, answer.motion, answer.motion.waypoint_times)
    timed = asked.at_given_times()
    if timed.motion is not None:
        yield measured(
            "this toolkit, given times", asked, timed.motion, timed.motion.waypoint_times
        )
    simple = asked.spline.motion(asked.problem)
    if simple is not None:
        yield measured("spline, dilated", asked, simple, simple.waypoint_times)
    for name in ("toppra", "ruckig-stop"):
        planned = load(name).solve(asked.problem).trajectory
        motion = None if planned is None else certified(asked.problem, planned)
        if motion is not None:
            yield measured(name, asked, motion, motion.waypoint_times)
    places = asked.problem.waypoints
    for speed, step in (("", 1 / RATE), (", as fast", answer.duration / (len(places) - 1))):
        yield sent(f"as commanded{speed}", asked, np.vstack([places[:1], places]), step)
        for name, rule in (("clamp", 1.0), ("filter and clip", FILTER)):
            yield sent(f"{name}{speed}", asked, followed(places, step, rule), step)
        yield tracked(f"Ruckig, target by target{speed}", asked, step)


def followed(places: Array, step: float, share: float) -> Array:
    """Return positions that take a share of the way to the target, clipped to the velocity."""
    found = [places[0]]
    for number in range(MOST_STEPS):
        target = places[min(number, len(places) - 1)]
        most = VELOCITY * step
        found.append(found[-1] + np.clip(share * (target - found[-1]), -most, most))
        if number >= len(places) and np.abs(found[-1] - places[-1]).max() < TOLERANCE / 100:
            break
    return np.array(found)


def sent(method: str, asked: Chunk, positions: Array, step: float) -> dict[str, Any]:
    """Measure positions that are sent step by step; a target's answer comes a step after it."""
    places = asked.problem.waypoints
    still = np.vstack([positions[:1], positions[:1], positions, positions[-1:], positions[-1:]])
    velocity = np.diff(still, axis=0) / step
    acceleration = np.diff(still, 2, axis=0) / step**2
    away = np.abs(positions - places[-1]).max(axis=1) > TOLERANCE
    last = int(np.flatnonzero(away)[-1]) + 1 if away.any() else 0
    found = np.abs(positions[1 : len(places) + 1] - places[: len(positions) - 1]).max()
    return {
        "method": method,
        "duration": last * step,
        "velocity": np.abs(velocity).max() / VELOCITY,
        "acceleration": np.abs(acceleration).max() / ACCELERATION,
        "deviation": found,
        "jerk": jerk_integral(still, step),
    }


def measured(method: str, asked: Chunk, motion: Trajectory, times: Array) -> dict[str, Any]:
    """Measure a motion that passes the targets at some times."""
    certificate = verify(asked.problem.without("tolerance", "least_times"), motion)
    passed = motion(np.minimum(times, motion.duration))
    step = 1 / RATE
    count = int(np.ceil(motion.duration / step)) + 4
    grid = np.clip(np.arange(-3, count) * step, 0.0, motion.duration)
    acceleration = certificate.acceleration
    return {
        "method": method,
        "duration": motion.duration,
        "velocity": certificate.velocity.value,
        "acceleration": np.nan if acceleration is None else acceleration.value,
        "deviation": np.abs(passed - asked.problem.waypoints).max(),
        "jerk": jerk_integral(motion(grid), step),
    }


def tracked(method: str, asked: Chunk, step: float) -> dict[str, Any]:
    """Let Ruckig follow the targets: at each step the next one is where it is to stop."""
    import ruckig

    places = asked.problem.waypoints
    solver = ruckig.Ruckig(JOINTS)
    state = ruckig.InputParameter(JOINTS)
    state.max_velocity, state.max_acceleration = [VELOCITY] * JOINTS, [ACCELERATION] * JOINTS
    state.max_jerk = [np.inf] * JOINTS
    state.current_position = places[0].tolist()
    state.current_velocity = state.current_acceleration = [0.0] * JOINTS
    way = ruckig.Trajectory(JOINTS)
    positions = [places[0]]
    for number in range(MOST_STEPS):
        state.target_position = places[min(number, len(places) - 1)].tolist()
        solver.calculate(state, way)
        position, velocity, _ = way.at_time(step)
        state.current_position, state.current_velocity = position, velocity
        positions.append(np.array(position))
        if number >= len(places) and way.duration <= step:
            break
    found = sent(method, asked, np.array(positions), step)
    # by Ruckig itself, between the steps: what it was told, not what differences say
    return found | {"velocity": min(found["velocity"], 1.0), "acceleration": 1.0}


def figure(path: Path) -> None:
    """Draw one joint of a noisy chunk: its targets, what a clamp sends, what is possible."""
    import matplotlib.pyplot as plt

    from trajopt.views.figures.style import BLACK, BLUE, GREY, STYLE_SHEET, VERMILION

    asked = chunk("noisy", DRAWN)
    motion = asked.fastest().motion
    assert motion is not None
    places = asked.problem.waypoints[:, DRAWN_JOINT]
    step = motion.duration / (len(places) - 1)
    sent_too = followed(asked.problem.waypoints, step, 1.0)[:, DRAWN_JOINT]
    times = np.linspace(0, motion.duration, 2000)
    with plt.rc_context(STYLE_SHEET):
        drawn, (above, below) = plt.subplots(
            2, 1, figsize=(7.0, 5.2), sharex=True, layout="constrained"
        )
        above.plot(asked.times, places, ".", color=GREY, label="targets, as the policy sends them")
        above.plot(
            step * np.arange(len(sent_too)), sent_too, color=VERMILION, drawstyle="steps-post"
        )
        above.plot(times, motion(times)[:, DRAWN_JOINT], color=BLUE)
        above.errorbar(
            motion.waypoint_times,
            places,
            yerr=TOLERANCE,
            fmt="none",
            ecolor=BLACK,
            elinewidth=0.8,
            label="targets ± 5 mrad, when the fastest motion passes them",
        )
        above.set_ylabel("joint position [rad]")
        above.legend(loc="upper right")
        differences = np.diff(np.pad(sent_too, 2, mode="edge"), 2) / step**2
        below.step(
            step * (np.arange(len(differences)) - 1),
            differences,
            color=VERMILION,
            where="mid",
            label="clamp: at least this, between two steps",
        )
        below.plot(
            times,
            motion(times, 2)[:, DRAWN_JOINT],
            color=BLUE,
            label="fastest motion within 5 mrad",
        )
        for side in (-1, 1):
            below.axhline(side * ACCELERATION, color=BLACK, linestyle="--", linewidth=0.8)
        below.set_ylabel("acceleration [rad/s²]")
        below.set_xlabel("time [s]")
        below.legend(loc="upper right")
        drawn.savefig(path, dpi=150)
        plt.close(drawn)


def jerk_integral(positions: Array, step: float) -> float:
    """Return ∫ jerk² of third differences, summed over joints, rad² s⁻⁵."""
    jerk = np.diff(positions, 3, axis=0) / step**3
    return float((jerk**2).sum() * step)


def main(
    count: int = 1000,
    compared: int = 40,
    proved: int = 16,
    output: Path = Path("results/chunks"),
    quick: bool = False,
    draw: Path | None = None,
    only: Literal[
        "all", "answers", "single", "steps", "rivals", "search", "bounds", "jerk", "quick"
    ] = "all",
) -> None:
    """Measure what is missing, and print medians.

    `count`: chunks that are answered; `compared`: beside rivals; `proved`: with a bound; `draw`:
    write the figure of the page into this file, and measure nothing.
    """
    if draw is not None:
        figure(draw)
        return
    each = 4 * BATCH if quick else count, 4 if quick else compared, 4 if quick else proved
    sizes = {
        "answers": (answered, each[0] // (len(KINDS) * BATCH)),
        "single": (alone, each[1] // len(KINDS)),
        "steps": (stepped, 5 * each[1] // len(KINDS)),
        "rivals": (rivals, each[1] // len(KINDS)),
        "search": (searched, each[2] // len(KINDS)),
        "bounds": (bounds, each[2] // len(KINDS)),
        "jerk": (partial(alone, jerk=True), each[2] // len(KINDS)),
        "quick": (partial(alone, jerk=True, quick=True), each[1] // len(KINDS)),
    }
    cells: dict[Any, Any] = {}
    for question, (measure, most) in sizes.items():
        for number in range(most):
            for kind in KINDS:
                if only in ("all", question):
                    cells[question, kind, number] = partial(_listed, measure, kind, number)
    table = kept(output / "chunks.csv", KEY, cells)
    found = table.groupby(["question", "method"], sort=False).median(numeric_only=True)
    save_table(found, output / "summary")
    print(found.to_string(float_format="{:.4g}".format))


def _listed(measure: Any, *of: Any) -> list[dict[str, Any]]:
    rows = list(measure(*of))
    names = ("method", "chunk", "duration", "spline", "planner", "cpu", "bound", "gap")
    more = ("velocity", "acceleration", "deviation", "jerk")
    return [{name: own.get(name, np.nan) for name in (*names, *more)} for own in rows]


if __name__ == "__main__":
    cyclopts.run(main)
