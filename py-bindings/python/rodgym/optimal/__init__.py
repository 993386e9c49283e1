"""Trajectories: the actions that make the most of an episode, as far as a search can tell.

    found = rodgym.optimize(env)
    found.actions, found.total

What the best known actions of our own tasks are is kept with the package: `best_known`.
"""

from rodgym.optimal.kept import Kept, kept, replay
from rodgym.optimal.search import Attempt, Optimized, Quadratic, optimize

__all__ = ["Attempt", "Kept", "Optimized", "Quadratic", "kept", "optimize", "replay"]
