"""Atomic writes: a file is replaced completely or not at all."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import mkdtemp

from knitlab.io.errors import CannotWrite, Fault

UNFINISHED = ".writing-"  # prefix of the folders of unfinished files


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield a temporary path, which replaces ``path`` on success; CannotWrite if it cannot."""
    folder = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        folder = Path(mkdtemp(prefix=UNFINISHED, dir=path.parent))
        temporary = folder / path.name
        yield temporary
        temporary.replace(path)
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        remedy = "free some space" if "space" in why or "quota" in why else "choose another folder"
        problem = f"cannot be written ({why}); {remedy}; the previous file is unchanged"
        raise CannotWrite([Fault(str(path), problem)]) from error
    finally:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)


def clear_unfinished(folder: Path) -> None:
    """Remove the unfinished files of killed processes from a folder and its subfolders."""
    for unfinished in (*folder.glob(f"{UNFINISHED}*"), *folder.glob(f"*/{UNFINISHED}*")):
        shutil.rmtree(unfinished, ignore_errors=True)


def can_write_into(folder: Path) -> bool:
    """Whether files can be written into a folder, which is made if there is none."""
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    return folder.is_dir() and os.access(folder, os.W_OK)
