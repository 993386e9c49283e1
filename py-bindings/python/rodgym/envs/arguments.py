"""The keywords of an environment as a table for its docstring, from the core's own table."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from rodgym import _native

Class = TypeVar("Class", bound=type)

#: Where the table goes in a docstring.
PLACE = "[arguments]"
#: Keywords that are not the core's.
PICTURE = (
    ("render_mode", "None", '`"rgb_array"`, `"human"` or None', "", "what `render` gives"),
    ("render_size", "None", "(width, height) or None", "pixel", "None: what suits the machine"),
)


def arguments(env_id: str) -> str:
    """Every keyword with default, what is allowed, unit and meaning: a Markdown table."""
    spec = _native.Batch(env_id, 1).spec
    physical = [
        (p["name"], f"{p['default']:g}", f"{p['low']:g} to {p['high']:g}", p["unit"], p["doc"])
        for p in spec["parameters"]
    ]
    others = [
        (k["name"], k["default"], k["allowed"], k["unit"], k["doc"]) for k in spec["keywords"]
    ]
    rows = [
        f"| `{name}` | {' | '.join(cells)} |" for name, *cells in (*physical, *others, *PICTURE)
    ]
    return "\n".join(
        ["| keyword | default | allowed | unit | meaning |", "|---|---|---|---|---|", *rows]
    )


def documented(env_id: str) -> Callable[[Class], Class]:
    """Puts the table of an environment's keywords into the docstring of its class."""

    def fill(environment: Class) -> Class:
        text = environment.__doc__ or ""
        indent = text[: text.index(PLACE)].rpartition("\n")[2]
        environment.__doc__ = text.replace(PLACE, arguments(env_id).replace("\n", "\n" + indent))
        return environment

    return fill
