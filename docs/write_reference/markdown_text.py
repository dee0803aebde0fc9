"""Pieces of Markdown."""

import re
from collections.abc import Iterable, Sequence


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; columns that no row fills are left out."""
    body = [[cell.replace("|", r"\|").replace("\n", " ") for cell in row] for row in rows]
    filled = [place for place in range(len(columns)) if any(row[place] for row in body)]
    lines = [[columns[place] for place in filled], ["---"] * len(filled)]
    lines += [[row[place] for place in filled] for row in body]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def code(text: object) -> str:
    """A name or a value as code; nothing for an empty one."""
    return f"`{text}`" if str(text) else ""


def plain(text: str) -> str:
    """The text of a docstring, which is reStructuredText, as Markdown."""
    text = re.sub(r":\w+:`(?:~?[\w.]+\.)?(\w+)`", r"``\1``", text)  # a reference to a name
    words_and_code = text.replace("``", "`").split("`")
    words_and_code[::2] = [words.replace("*", r"\*") for words in words_and_code[::2]]
    return "`".join(words_and_code)


def first_paragraph(docstring: str | None) -> str:
    """The first paragraph of a docstring on one line."""
    return plain(" ".join((docstring or "").strip().split("\n\n")[0].split()))
