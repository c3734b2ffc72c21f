"""Planners, commands and options that had another name: whoever uses the old one is told the new.

Stored trials keep the name of their day, and are read under the new one.
"""

from __future__ import annotations

RENAMED = {"certify": "prove"}


OF_OTHER_TOOLS = {
    "pop_size": "population",
    "popsize": "population",
    "n_particles": "population",
    "swarmsize": "population",
    "epoch": "iterations",
    "epochs": "iterations",
    "generations": "iterations",
    "n_gen": "iterations",
    "maxiter": "iterations",
    "budget": "evaluations",
    "max_evals": "evaluations",
    "maxfev": "evaluations",
    "n_eval": "evaluations",
}
"""Options of optimisers in other libraries, and what they are called here."""


def of_other_tools(option: str) -> str:
    """Return our word for an option of another library's optimiser; empty if there is none."""
    return OF_OTHER_TOOLS.get(option.lower(), "")


def current(name: str) -> str:
    """Return today's name of what had this name."""
    return RENAMED.get(name, name)


def told(given: str, known: str) -> str:
    """Return a sentence where a name was given whose new name is known, or empty text.

    Args:
        given: As it was written, perhaps an option: `--certify`.
        known: What has names here: "planner", "command" or "option".
    """
    word = given.lstrip("-")
    if word not in RENAMED:
        return ""
    dashes = given[: len(given) - len(word)]
    return f"the {known} {given} is now called {dashes}{RENAMED[word]}"
