"""The fastest timing of a given path, under every kind of limit that states its rows.

- `path`: the path's geometry: where it has to stop, and a parameter whose speed is finite at rest;
- `law`: what the limits ask along the path, as seven numbers for each row and point;
- `program`: the squared path speed that takes the least time on given knots;
- `engine`: knots that move to where time is lost, and the motion;
- `ceilings`: the speeds that each limit allows along a path;
- `bound`: a time that no motion along a path falls below;
- `planner`: the planner `along`, which chooses the path too.
"""
