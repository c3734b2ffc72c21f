"""Does an independent program find smoother motions than `smooth` on ten random problems?

    python -m experiments.front_check

The independent program has septic pieces with jumps of jerk between them, exact integration, limits
at four instants per piece, free segment times and three starts, by IPOPT. It shares no code with
`smooth`. Limits are imposed at instants only, so its global optimum is at most the least integral;
it may end in a local optimum. The table goes to `front-check.csv` and `.md` in `--output`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cyclopts
import numpy as np
import pandas as pd

from baselines.front.least import least
from baselines.lower_bound.incumbent import incumbent
from experiments.common.output import save_table
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.planners.planner import backend

FACTOR = 1.3  # duration, relative to the shortest known
_CELLS = 8
_POWERS = 5  # number of powers of jerk in a piece
_INSTANTS = (0.25, 0.5, 0.75, 1.0)
_OPTIONS = {"print_level": 0, "sb": "yes", "tol": 1e-9, "max_iter": 500}


def turning_problem(seed: int) -> Problem:
    """A random walk of two to four segments and one to four joints."""
    rng = np.random.default_rng(seed)
    segments, joints = int(rng.integers(2, 5)), int(rng.integers(1, 5))
    walk = np.cumsum(rng.normal(size=(segments + 1, joints)), axis=0)
    limits = Limits(rng.uniform(1.0, 2.0, joints), rng.uniform(2.0, 5.0, joints))
    return Problem(walk, limits, name=f"walk {seed}")


def independent(problem: Problem, duration: float) -> float:
    """The least integral that IPOPT finds from three starts; infinite if none succeeds."""
    ca: Any = backend("casadi")
    unit = duration / problem.segments
    w = problem.waypoints
    velocity = problem.limits.velocity * unit
    acceleration = problem.limits.acceleration * unit**2
    segments, joints = problem.segments, problem.joints
    times = ca.MX.sym("T", segments)
    jerks = [ca.MX.sym("j", joints, _POWERS) for _ in range(segments * _CELLS)]
    x, v, a = ca.MX(w[0]), ca.MX.zeros(joints), ca.MX.zeros(joints)
    total: Any = 0
    rows: list[tuple[Any, Any, Any]] = []
    for number, c in enumerate(jerks):
        h = times[number // _CELLS] / _CELLS
        for i in range(_POWERS):
            for k in range(_POWERS):
                total += h * ca.sum1(c[:, i] * c[:, k]) / (i + k + 1)
        for s in _INSTANTS:
            rise = [c[:, k] * s ** (k + 1) / (k + 1) for k in range(_POWERS)]
            gain = [c[:, k] * s ** (k + 2) / ((k + 1) * (k + 2)) for k in range(_POWERS)]
            rows.append((a + h * sum(rise), *acceleration.T))
            rows.append((v + h * s * a + h**2 * sum(gain), *velocity.T))
        way = [c[:, k] / ((k + 1) * (k + 2) * (k + 3)) for k in range(_POWERS)]
        x = x + h * v + h**2 / 2 * a + h**3 * sum(way)
        a, v = rows[-2][0], rows[-1][0]
        if (number + 1) % _CELLS == 0:
            own = w[(number + 1) // _CELLS]
            rows.append((x, own, own))
    still = np.zeros(joints)
    rows += [(v, still, still), (a, still, still)]
    rows.append((ca.sum1(times), np.array([segments]), np.array([segments])))
    variables = ca.vertcat(times, *map(ca.vec, jerks))
    constraints = ca.vertcat(*(row[0] for row in rows))
    nlp = {"x": variables, "f": total, "g": constraints}
    solver = ca.nlpsol("check", "ipopt", nlp, {"print_time": False, "ipopt": _OPTIONS})
    count = variables.numel() - segments
    best = np.inf
    for power in (0.0, 0.5, 1.0):
        shares = np.abs(np.diff(w, axis=0)).max(axis=1) ** power
        found = solver(
            x0=np.append(segments * shares / shares.sum(), np.zeros(count)),
            lbx=np.append(np.full(segments, 1e-2), np.full(count, -np.inf)),
            lbg=np.concatenate([row[1] for row in rows]),
            ubg=np.concatenate([row[2] for row in rows]),
        )
        if solver.stats()["success"]:
            best = min(best, float(found["f"]) / unit**5)
    return best


def main(output: Path = Path("front-check"), problems: int = 10, quick: bool = False) -> None:
    """Compare both on random problems.

    Args:
        output: Folder of the table.
        problems: How many.
        quick: Two problems.
    """
    rows = []
    for seed in range(2 if quick else problems):
        problem = turning_problem(seed)
        known = incumbent(problem, 10.0)
        assert known is not None
        duration = FACTOR * known.duration
        ours = least(problem, "jerk", duration, known.trajectory)
        theirs = independent(problem, duration)
        value = np.nan if ours is None else ours.value
        rows.append(
            {
                "problem": problem.name,
                "segments × joints": f"{problem.segments} × {problem.joints}",
                "duration, s": f"{duration:.4f}",
                "smooth, rad²/s⁵": f"{value:.6g}",
                "independent, rad²/s⁵": f"{theirs:.6g}",
                "smooth above, %": f"{100 * (value / theirs - 1):.3f}",
            }
        )
        print(", ".join(rows[-1].values()), flush=True)
    save_table(pd.DataFrame(rows).set_index("problem"), output / "front-check")


if __name__ == "__main__":
    cyclopts.run(main)
