"""Speed along a path against the ceiling of each limit."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from trajopt.core.limits import KINDS
from trajopt.retiming import Retiming
from trajopt.views.figures.plots import Picture, styled
from trajopt.views.figures.style import BLACK, CURVES, DASHES, GREY, text

_SAMPLES = 1200
_HEADROOM = 1.6  # of the axis, relative to the highest speed
_STILL = 1e-3  # of the highest speed: below, there is no direction whose ceiling is drawn


@styled
def speed(found: Retiming, title: str = "") -> Figure:
    """Draw the speed of a motion along its path, and what each limit allows there.

    The speed is the root of the sum of the joints' squared velocities. A ceiling is the maximum
    velocity curve of a limit. Limits of jerk have none: they hold the motion where it is below all.
    """
    motion = found.motion
    if motion is None:
        raise ValueError(found.trial.message)
    times = np.linspace(0.0, motion.duration, _SAMPLES)
    speeds = np.linalg.norm(motion(times, 1), axis=1)
    moving = speeds > _STILL * speeds.max()
    passed = np.append(0.0, np.cumsum(np.diff(times) * (speeds[1:] + speeds[:-1]) / 2))
    share = 100 * passed / passed[-1]
    figure = Picture(figsize=(7.0, 3.1), layout="constrained")
    axes = figure.subplots()
    top = _HEADROOM * speeds.max()
    ceilings = found.ceilings(times[moving])
    for (key, ratio), colour, dashes in zip(
        ceilings.items(), CURVES, (*DASHES[1:], *DASHES), strict=False
    ):
        label = f"ceiling: {KINDS[key].name()}"
        axes.plot(
            share[moving], ratio * speeds[moving], color=colour, linestyle=dashes, label=label
        )
    axes.plot(share, speeds, color=BLACK, label="fastest motion along the path")
    for waypoint in np.interp(motion.waypoint_times[1:-1], times, share):
        axes.axvline(waypoint, color=GREY, linewidth=0.5, zorder=0)
    axes.set_xlim(0, 100)
    axes.set_ylim(0, top)
    axes.set_xlabel("way along the path (%); grey: waypoints")
    axes.set_ylabel(f"speed ({found.problem.shared_unit(1)})")
    axes.set_title(text(title), loc="left", wrap=True)
    figure.legend(loc="outside lower center", ncols=4)
    return figure
