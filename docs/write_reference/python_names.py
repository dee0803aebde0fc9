"""The list of public Python names, with what each is for."""

import inspect
from collections.abc import Iterable
from types import ModuleType

from markdown_text import code, first_paragraph, table

import knitlab
from knitlab.cubes.query import KnitlabAccessor


def page() -> str:
    """Tables of the names of ``knitlab``, of ``knitlab.plot`` and of ``cube.knitlab``."""
    public = [name for name in knitlab.__all__ if not name.startswith("_")]
    own = [name for name in public if not isinstance(getattr(knitlab, name), ModuleType)]
    methods = [name for name in vars(KnitlabAccessor) if not name.startswith("_")]
    parts = {
        "knitlab": _table(knitlab, own),
        "knitlab.plot": _table(knitlab.plot, knitlab.plot.__all__),
        "cube.knitlab": _table(KnitlabAccessor, methods),
    }
    return "\n\n".join(f"## {heading}\n\n{rows}" for heading, rows in parts.items())


def _table(owner: object, names: Iterable[str]) -> str:
    rows = [(code(each), first_paragraph(inspect.getdoc(getattr(owner, each)))) for each in names]
    return table(("name", "purpose"), rows)
