"""Problems, trajectories and solutions: the data that every other folder works with.

In reading order:

- `exceptions`: errors that name the file, the key, the joint and the value;
- `polynomials`: roots, extrema and bounds of many polynomials at once;
- `trajectory`: the piecewise polynomial, with `piecewise` (from SciPy) and `interpolation` (from
  samples);
- `limits`, a kind a file; `demand`, what may be asked of the way; `route`, waypoints and demands;
- `problem`, the route under limits; `end_states` in which no motion begins or ends;
- `solution`: a planner's answer;
- `problem_file`, `arm_file`: problems and robot arms in TOML;
- `files`, `tables`, `numerals`, `units`, `built_in`: what all readers of files share.
"""
