"""Reads what recipes write as Python, without running any of it.

rl-baselines3-zoo writes keywords as text, ``"dict(net_arch=[64, 64], activation_fn=nn.ReLU)"``, and
evaluates it. Here the text is parsed: literals, ``dict(...)`` and the names of torch's layers and
optimizers are read, anything else is refused by name. Classes are found by their dotted names and
must be of the kind that is asked for.
"""

from __future__ import annotations

import ast
import importlib
import inspect
from collections.abc import Iterator, Mapping
from typing import Any

import rodgym


class RecipeError(rodgym.RodgymError, ValueError):
    """A recipe that is missing or cannot be used."""


def expression(name: str, text: str) -> Any:
    """The value of an expression; ``name`` is what errors call it.

    Raises
    ------
    RecipeError: text that is no expression, or holds a name or an operation that is not allowed
    """
    try:
        return _value(ast.parse(text.strip(), mode="eval").body)
    except SyntaxError:
        raise RecipeError(f"{name} = {text!r} is no expression") from None
    except RecipeError as error:
        raise RecipeError(f"{name} = {text!r}: {error}") from None
    except (RecursionError, MemoryError):
        raise RecipeError(f"{name} is nested too deeply") from None


def _value(node: ast.expr) -> Any:
    match node:
        case ast.Constant(value=bool() | int() | float() | str() | None as value):
            return value
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
            return -value
        case ast.List(elts=items):
            return [_value(item) for item in items]
        case ast.Tuple(elts=items):
            return tuple(_value(item) for item in items)
        case ast.Dict(keys=keys, values=values) if None not in keys:
            pairs = zip(keys, values, strict=True)
            return {_value(key): _value(value) for key, value in pairs if key is not None}
        case ast.Call(func=ast.Name(id="dict"), args=[], keywords=keywords):
            if any(keyword.arg is None for keyword in keywords):
                raise RecipeError("** is not allowed")
            return {str(keyword.arg): _value(keyword.value) for keyword in keywords}
        case ast.Name() | ast.Attribute():
            return torch_class(ast.unparse(node))
    raise RecipeError(
        f"{ast.unparse(node)!r} is not allowed: a recipe holds literals, dict(...) and the names "
        "of layers and optimizers of torch, such as nn.ReLU"
    )


def torch_class(name: str) -> type:
    """A layer (``nn.ReLU``, ``ReLU``) or optimizer (``th.optim.AdamW``) of torch, by name.

    Raises
    ------
    RecipeError: any other name
    """
    import torch

    if name == "RMSpropTFLike":
        from stable_baselines3.common.sb2_compat.rmsprop_tf_like import RMSpropTFLike

        return RMSpropTFLike
    where, _, last = name.rpartition(".")
    kinds: dict[str, tuple[Any, type]] = {
        **dict.fromkeys(("", "nn", "th.nn", "torch.nn"), (torch.nn, torch.nn.Module)),
        **dict.fromkeys(("optim", "th.optim", "torch.optim"), (torch.optim, torch.optim.Optimizer)),
    }
    if where in kinds:
        module, kind = kinds[where]
        found = getattr(module, last, None)
        if inspect.isclass(found) and issubclass(found, kind):
            return found
    raise RecipeError(f"{name!r} is no class of torch.nn or torch.optim")


def named_class(key: str, name: Any, kind: type) -> type:
    """A class by its dotted name, of a kind that may stand there.

    The kind is checked before anything is made of it: a recipe can name a wrapper, but not just
    any callable.

    Raises
    ------
    RecipeError: no such class, or one of another kind
    """
    module, _, last = str(name).rpartition(".")
    try:
        found = getattr(importlib.import_module(module), last) if module else None
    except (ImportError, AttributeError) as error:
        raise RecipeError(f"{key}: {name!r} is not found ({error})") from error
    if not (inspect.isclass(found) and issubclass(found, kind)):
        raise RecipeError(
            f"{key}: {name!r} must be the dotted name of a class derived from {kind.__name__}"
        )
    return found


def classes(key: str, given: Any, kind: type) -> list[tuple[type, dict[str, Any]]]:
    """Classes with their keywords, as rl-baselines3-zoo lists them.

    ``a.B``, ``[a.B, c.D]`` and ``[{a.B: {keyword: value}}]`` are read.

    Raises
    ------
    RecipeError: another form, or see `named_class`
    """
    return [
        (named_class(key, name, kind), keywords) for name, keywords in named_keywords(key, given)
    ]


def named_keywords(key: str, given: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """The names of such a list with their keywords; nothing is imported."""
    for item in given if isinstance(given, list | tuple) else [given] if given else []:
        if isinstance(item, str):
            yield item, {}
        elif isinstance(item, Mapping) and len(item) == 1:
            ((name, keywords),) = item.items()
            if not isinstance(keywords, Mapping | None):
                raise RecipeError(f"{key}: keywords of {name} = {keywords!r} must be a mapping")
            yield str(name), dict(keywords or {})
        else:
            raise RecipeError(
                f"{key} = {item!r} must be a dotted name, or one dotted name with its keywords"
            )
