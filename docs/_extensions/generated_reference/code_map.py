"""The map of the code: every package and module with the first line of its docstring."""

import ast
from pathlib import Path

from generated_reference.markdown import code, first_paragraph, table
from knitlab.io.shipped import PACKAGE


def page() -> str:
    """Every package, and a table of its modules."""
    parts = []
    for package in sorted(path.parent for path in PACKAGE.glob("*/**/__init__.py")):
        modules = sorted(path for path in package.glob("*.py") if path.name != "__init__.py")
        rows = [(code(path.stem), _summary(path)) for path in modules]
        name = ".".join(package.relative_to(PACKAGE.parent).parts)
        parts += [f"## {name}", _summary(package / "__init__.py")]
        parts.append(table(("module", "purpose"), rows))
    return "\n\n".join(parts)


def _summary(path: Path) -> str:
    return first_paragraph(ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))))
