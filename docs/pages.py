"""Writes the pages of the environments from their docstrings: `python docs/pages.py`."""

from __future__ import annotations

import inspect
from pathlib import Path

from rodgym.envs import FinEnv, PendulumEnv

#: Page, title and class of each family of environments.
PAGES = (
    ("pendulum.md", "The elastic pendulum", PendulumEnv),
    ("fin.md", "The flexible fin", FinEnv),
)


def page(title: str, environment: type) -> str:
    """The page's text."""
    text = inspect.getdoc(environment)
    assert text is not None
    return f"<!-- Written by docs/pages.py from the docstring. -->\n\n# {title}\n\n{text.strip()}\n"


if __name__ == "__main__":
    for name, title, environment in PAGES:
        (Path(__file__).parent / name).write_text(page(title, environment))
