"""Promise: the package's modules depend on one another in one direction only."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
import rodgym

ROOT = Path(rodgym.__file__).parent


def modules(root: Path) -> dict[str, Path]:
    """Files of the package by module name."""
    named = {}
    for path in root.rglob("*.py"):
        parts = (root.name, *path.relative_to(root).with_suffix("").parts)
        named[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return named


def imports(path: Path) -> set[str]:
    """Names that a file imports, in functions too, but not those for type checkers only."""
    found = set()
    trees: list[ast.AST] = [ast.parse(path.read_text())]
    while trees:
        node = trees.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            trees += node.orelse
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0 and node.module is not None, f"{path}: name the module in full"
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        else:
            trees += ast.iter_child_nodes(node)
    return found


def graph(root: Path) -> dict[str, set[str]]:
    """What each module needs before it. A module needs the packages that it imports from, except
    those that it is in itself: they are being imported already."""
    known = modules(root)
    needs: dict[str, set[str]] = {}
    for name, path in known.items():
        needs[name] = set()
        for target in imports(path) & known.keys():
            parts = target.split(".")
            chain = {".".join(parts[: i + 1]) for i in range(len(parts))}
            needs[name] |= {
                one for one in chain if one != name and not f"{name}.".startswith(f"{one}.")
            }
    return needs


def test_the_import_graph_has_no_cycle():
    needs = graph(ROOT)
    assert "rodgym._batch" in needs["rodgym.vector"] and len(needs) > 50
    TopologicalSorter(needs).prepare()


def test_a_cycle_through_a_function_is_found(tmp_path):
    package = tmp_path / "house"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "one.py").write_text("from house import two\n")
    (package / "two.py").write_text("def late():\n    from house.one import thing\n")
    with pytest.raises(CycleError):
        TopologicalSorter(graph(package)).prepare()
