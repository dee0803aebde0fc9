"""The reference of the Python API: all that ``knitlab.__all__`` names, by autodoc."""

import inspect
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import knitlab
from knitlab.cubes.query import KnitlabAccessor
from knitlab.model.settings import ModelOptions


def page() -> str:
    """The public names of knitlab, of its namespaces, and what is reached through them."""
    names = [name for name in knitlab.__all__ if not name.startswith("_")]
    spaces = [name for name in names if inspect.ismodule(getattr(knitlab, name))]
    own = [f"knitlab.{name}" for name in names if name not in spaces]
    parts = list(_section("Functions and classes", own))
    for space in spaces:
        module: ModuleType = getattr(knitlab, space)
        parts += _section(
            f"knitlab.{space}", [f"knitlab.{space}.{each}" for each in _public(module)]
        )
    parts += _section("On an open cube", [_path(KnitlabAccessor)])
    parts += _section("Attributes of knitlab.Model", [_path(ModelOptions)])
    return "\n".join(parts)


def _path(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


def _public(module: ModuleType) -> list[str]:
    listed: list[str] = getattr(module, "__all__", [])
    return listed or [
        name for name, each in vars(module).items() if name[0] != "_" and inspect.isfunction(each)
    ]


def _section(heading: str, paths: list[str]) -> Iterator[str]:
    yield from (heading, "-" * len(heading), "")
    if len(paths) > 1:
        yield from (
            ".. autosummary::",
            "   :nosignatures:",
            "",
            *(f"   {each}" for each in paths),
            "",
        )
    for path in paths:
        kind, options = _directive(_found(path))
        yield from (f".. {kind}:: {path}", *(f"   {option}" for option in options), "")


def _directive(each: Any) -> tuple[str, tuple[str, ...]]:
    if inspect.isclass(each):
        return "autoclass", (":members:",)
    return ("autofunction" if callable(each) else "autodata"), ()


def _found(path: str) -> Any:
    module, _, name = path.rpartition(".")
    return getattr(__import__(module, fromlist=[name]), name)
