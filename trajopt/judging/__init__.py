"""The exact judge: peaks, repair, dilation and the certified duration of a motion.

In reading order:

- `repair`: a motion close to the given one that passes every waypoint and does not jump;
- `slower`: a slower motion with the same end states, by `joint_program`;
- `verification`: `verify`, which judges the repaired motion;
- `certificate`: what it says of the motion, also in words;
- `smoothness`: ∫ jerk² and ∫ acceleration² of a motion;
- `passing`: the times at which a motion passes waypoints;
- `ends`: the states at the ends of a motion, and how long it stands there;
- `turns`: whole turns of continuous joints;
- `evidence`: the verdict on a log of samples. The `premise` says how accurately these are known
  (`lattice`, `scatter`, `log_velocities`, `lost_rows`); a few rows prove much (`log_windows`), all
  together the rest (`log_joint`, `tube`, `tube_proof`);
- `check_proof`: the kernel of all proofs of lower bounds, in exact fractions, with the standard
  library alone; it is a script too, which the site and the archive of records ship as it is;
- `check_front`: the same of bounds of the smoothness, a script beside the kernel;
- `check_spline353`: the same of the duration of all 3-5-3 splines;
- `check_tube`: the same of the share of its limits that every motion near a log's samples uses;
- `proved_bounds`: those of problems, asked about a `Problem` and arrays.
"""
