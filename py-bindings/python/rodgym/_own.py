"""Code of the user's own that is named by text: ``mine.py:Class``, ``package.module:Class``.

An environment is named in the same way by the id that its module registers: ``mine.py:My/Env-v0``
(Gymnasium itself reads ``package.module:My/Env-v0``).
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from rodgym.errors import ParameterError
from rodgym.zoo import is_zoo


def is_named(source: str) -> bool:
    """Whether the text is of the form MODULE:NAME."""
    module, colon, name = source.rpartition(":")
    named = bool(colon and module and name) and not is_zoo(source)
    return named and not Path(source).exists()


def module_of(place: str) -> ModuleType:
    """The module of a file (``mine.py``) or a name, imported once; the working folder is searched.

    Raises
    ------
    ParameterError: there is none
    """
    if not place.endswith(".py"):
        if "" not in sys.path and str(Path.cwd()) not in sys.path:
            sys.path.insert(0, str(Path.cwd()))
        try:
            return importlib.import_module(place)
        except ModuleNotFoundError as error:
            raise ParameterError(f"there is no module {place!r}: {error}") from error
    path = Path(place).resolve()
    name = path.stem
    known = sys.modules.get(name)
    if known is not None and getattr(known, "__file__", None) == str(path):
        return known
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None or not path.is_file():
        raise ParameterError(f"there is no file {place!r}")
    if known is not None:
        raise ParameterError(f"{place!r} has the name of the module {name!r}: give it another one")
    module = importlib.util.module_from_spec(spec)
    # Pickles of its classes find it by its name.
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
