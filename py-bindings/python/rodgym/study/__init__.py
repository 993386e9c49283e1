"""Sweeps: a grid of cases, each a pure function of its keywords, gathered in one table.

``spec`` reads the YAML of a study and lists its cases; ``case`` computes one; ``engine`` runs what
is missing from a table, on whatever backend; ``plot`` draws it. A backend is a function that takes
cases and gives back rows as they are finished (`engine.Backend`): nothing else is needed to run a
study on another machine.
"""

from rodgym.study.case import run_case
from rodgym.study.engine import Backend, local, run_study
from rodgym.study.spec import Case, Study, StudyError, plans, read

__all__ = [
    "Backend",
    "Case",
    "Study",
    "StudyError",
    "local",
    "plans",
    "read",
    "run_case",
    "run_study",
]
