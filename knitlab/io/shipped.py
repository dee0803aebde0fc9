"""Folders of the parameters and workflows that are shipped with knitlab."""

from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent


def shipped(folder: str) -> Path:
    """Folder ``params`` or ``workflows``: inside an installed package, or beside its source."""
    installed = PACKAGE / "shipped" / folder
    return installed if installed.is_dir() else PACKAGE.parent / folder
