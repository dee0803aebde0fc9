"""Sphinx extension: reference pages end with text that is generated from the code at each build."""

from collections.abc import Callable

from sphinx.application import Sphinx

from generated_reference import code_map, figures, public_api, settings, variables

GENERATED: dict[str, Callable[[], str]] = {
    "reference/code": code_map.page,
    "reference/figures": figures.page,
    "reference/python": public_api.page,
    "reference/settings": settings.page,
    "reference/variables": variables.page,
}
"""What writes the rest of a page, by the page's name."""


def complete(_: Sphinx, name: str, source: list[str]) -> None:
    """Append to a page what is generated for it."""
    if name in GENERATED:
        source[0] += "\n\n" + GENERATED[name]()


def always_outdated(*_: object) -> list[str]:
    """Pages to read at every build, for the code may have changed where their own text has not."""
    return list(GENERATED)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the extension."""
    app.connect("source-read", complete)
    app.connect("env-get-outdated", always_outdated)
    return {"parallel_read_safe": True}
