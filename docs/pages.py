"""Writes the pages of the environments from their docstrings, and the code of the toy crate into
extending.md: `python docs/pages.py`.
"""

from __future__ import annotations

import inspect
import re
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


def with_code(text: str, sources: Path) -> str:
    """A page whose blocks that begin with `// name` show the file of that name."""

    def block(found: re.Match[str]) -> str:
        return f"```rust\n// {found[1]}\n{(sources / found[1]).read_text()}```"

    return re.sub(r"```rust\n// (\S+)\n.*?```", block, text, flags=re.DOTALL)


if __name__ == "__main__":
    extending = Path(__file__).parent / "extending.md"
    toy = Path(__file__).parents[1] / "tests" / "toy" / "src"
    extending.write_text(with_code(extending.read_text(), toy))
    for name, title, environment in PAGES:
        (Path(__file__).parent / name).write_text(page(title, environment))
