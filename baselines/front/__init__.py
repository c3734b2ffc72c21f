"""The front of duration and smoothness (docs/mathematics.md, section 12).

    from baselines.front.planner import Smooth
    solution = Smooth(duration=2.0).solve(problem)
    print(solution.stats["value"])

In reading order:

- `planner.py`: the registered planner `smooth`;
- `least.py`: the smoothest motion of a duration, the shortest of a smoothness, within all limits;
- `spline_program.py`: the program that IPOPT solves;
- `curve.py`: the front, with a proved lower bound at each of its points;
- `bound.py`: the search for a proof, over all segment times;
- `dual.py`: the lower bound of a simplex of segment times.
"""
