"""The results of a comparison: its tables, its figures, and what a notebook shows of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trajopt.core.exceptions import InvalidInput
from trajopt.views import inline
from trajopt.views.analysis.results import Tables

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Results(Tables):
    """The trials of a run: tables (`Tables` lists them), figures, and a view in a notebook."""

    def __repr__(self) -> str:
        return inline.text(self)

    def _repr_html_(self) -> str:
        return inline.html(self)

    def plot(self, problem: str | None = None, *, kind: str | None = None) -> Figure:
        """Draw one problem's certified durations, or a figure of all problems.

        Args:
            problem: its name, for a row per planner, the shortest first; may be left out where
                there is one problem only.
            kind: a figure of all problems: `profile`, the share of problems that a planner solves
                within a factor of the best (the default for several problems); `gaps`, the share
                within a gap to the optimum; `anytime-seconds` or `anytime-evaluations`, the gap to
                the optimum against seconds or evaluations.

        Raises:
            InvalidInput: There is no problem of this name, or no such figure of these trials.
        """
        from trajopt.views.figures import draw, plots  # Matplotlib is imported where it draws

        lines = self.lines()
        names = list(dict.fromkeys(line.problem for line in lines))
        if problem is not None and kind is not None:
            right = f"left out beside kind={kind!r}, which is a figure of all problems"
            raise InvalidInput("problem", right, value=problem)
        if problem is None and (kind is not None or len(names) > 1):
            pictures = dict(draw.of_suite(self))
            if kind is not None and kind not in pictures:
                raise InvalidInput("kind", f"one of {', '.join(pictures)}", value=kind)
            return pictures[kind or "profile"]()
        wanted = problem or names[0]
        if wanted not in names:
            raise InvalidInput("problem", f"one of {', '.join(names)}", value=problem)
        own = [line for line in lines if line.problem == wanted]
        return plots.durations(own, title=str(wanted))
