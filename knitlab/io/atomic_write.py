"""Atomic writes: a file is replaced completely or not at all."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from knitlab.io.errors import CannotWrite, Mistake

UNFINISHED = ".writing-"  # prefix of the folders of unfinished files


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield a temporary path, which replaces ``path`` on success; CannotWrite if it cannot."""
    folder = path.parent
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory("", UNFINISHED, folder, ignore_cleanup_errors=True) as unfinished:
            temporary = Path(unfinished, path.name)
            yield temporary
            temporary.replace(path)
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        hint = "free some space" if "space" in why or "quota" in why else "choose another folder"
        message = f"cannot be written ({why}); {hint}; the previous file is unchanged"
        raise CannotWrite([Mistake(str(path), message)]) from error


def clear_unfinished(folder: Path) -> None:
    """Remove the unfinished files of killed processes from a folder and its subfolders."""
    for unfinished in (*folder.glob(f"{UNFINISHED}*"), *folder.glob(f"*/{UNFINISHED}*")):
        shutil.rmtree(unfinished, ignore_errors=True)


def can_write_into(folder: Path) -> bool:
    """Whether files can be written into a folder, which is made if there is none."""
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    return folder.is_dir() and os.access(folder, os.W_OK)
