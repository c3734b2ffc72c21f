"""Pictures of trials. In reading order:

- `draw`: which figures a comparison has, and their files.
- `plots`: durations, convergence and gaps of one problem.
- `motions`: every joint of one motion against time.
- `explanation`: the gap of one planner, and its use of every limit.
- `sampling`: points of curves.
- `style`: colours, line styles and texts.
"""
