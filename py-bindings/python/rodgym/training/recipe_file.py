"""Reads YAML files of recipes, those that rl-baselines3-zoo has written too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rodgym.training.expressions import RecipeError

#: How rl-baselines3-zoo's ``config.yml`` marks its one dictionary, and tuples in it.
ORDERED = "tag:yaml.org,2002:python/object/apply:collections.OrderedDict"
TUPLE = "tag:yaml.org,2002:python/tuple"


def entries(path: Path) -> dict[str, Any]:
    """What a file of recipes holds.

    Raises
    ------
    RecipeError: no file, no YAML, or YAML that would make objects
    """
    import yaml

    if path.suffix == ".py":
        raise RecipeError(f"{path} is a program: recipes are read from YAML only")

    class Loader(yaml.SafeLoader):
        """Safe YAML, and the two marks above, read as a dictionary and a list."""

    def ordered(loader: Any, node: Any) -> dict[str, Any]:
        (pairs,) = loader.construct_sequence(node, deep=True)
        return dict(pairs)

    Loader.add_constructor(ORDERED, ordered)
    Loader.add_constructor(TUPLE, lambda loader, node: loader.construct_sequence(node, deep=True))
    try:
        found = yaml.load(path.read_text(encoding="utf-8"), Loader)  # a safe loader
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise RecipeError(f"no recipe file {path}: {reason}") from error
    except (yaml.YAMLError, TypeError, ValueError) as error:
        raise RecipeError(f"{path} is not YAML: {error}") from error
    if not isinstance(found, dict):
        raise RecipeError(f"{path} holds no entries 'ENV_ID: {{...}}'")
    return found
