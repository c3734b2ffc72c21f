"""Readers and writers of other programs' files: robots, limits, waypoints and motions.

In reading order:

- `robot_limits`: limits by joint name, from `arms` (built-in), `urdf` and `joint_limits` (MoveIt);
- `waypoints`: the problem of a file of waypoints under a robot's limits;
- `samples`: samples of a motion, from `samples_csv` and `joint_trajectory` (ROS messages);
- `motion`: a motion from any file or object;
- `on_cycle`: a motion moved to whole control cycles, joint by joint (`judging.joint_program`);
- `csv_file`, `yaml_file`: what the readers share.
"""
