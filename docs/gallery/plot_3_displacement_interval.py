"""
3. The displacement interval
============================

Why the exact formulation needs no discretisation. One joint moves over one segment of given time
``T`` from velocity ``u`` to velocity ``w``, with its velocity within ``±V`` and its acceleration
within ``±A``. The displacements that it can reach form an interval. The upper end comes from the
profile that accelerates first, the lower end from the one that brakes first.
"""

import numpy as np
from matplotlib import pyplot as plt
from scipy.integrate import trapezoid

T, u, w = 1.0, 0.5, 0.2  # s, rad/s, rad/s
V, A = 1.2, 2.0  # rad/s, rad/s²


def profile(sign):
    """Return the times and velocities of the extreme profile: a ramp, perhaps a cruise, a ramp."""
    peak = sign * min(V, (sign * (u + w) + A * T) / 2)
    first = abs(peak - u) / A
    last = abs(peak - w) / A
    return [0, first, T - last, T], [u, peak, peak, w]


figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
ends = []
for sign, colour in ((1, "#D55E00"), (-1, "#0072B2")):
    times, velocities = profile(sign)
    ends.append(trapezoid(velocities, times))
    axes.plot(times, velocities, color=colour, label=f"displacement {ends[-1]:+.3f} rad")
upper = np.interp(np.linspace(0, T, 200), *profile(1))
lower = np.interp(np.linspace(0, T, 200), *profile(-1))
axes.fill_between(np.linspace(0, T, 200), lower, upper, color="0.93")
axes.axhline(V, color="0.5", linestyle="--", linewidth=0.8)
axes.set_xlabel("time [s]")
axes.set_ylabel("velocity [rad/s]")
axes.legend()
plt.show()

# %%
# Every displacement between the two is reached by some profile in the grey area, and none
# outside. So the minimum-time problem has few variables: the segment times and the waypoint
# velocities.

print(f"reachable displacements: {ends[1]:+.4f} to {ends[0]:+.4f} rad")
