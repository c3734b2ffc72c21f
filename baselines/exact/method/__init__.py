"""The method of `exact` and `exact-jerk`, which knows neither program.

In reading order:

- `planner`: a planner whose answer is the best of the local optima that several starts lead to.
- `scaled`: a problem without units.
- `interior_point`, `chain`, `crossover`: the method, its Newton steps, the limits that are active.
- `segments`, `pieces`: motions between waypoints, of piecewise linear acceleration.
- `brief_steps`: problems with waypoints that rounding may miss.
"""
