"""What comes in and goes out: limits, robots, waypoints, motions, and what a controller runs."""
