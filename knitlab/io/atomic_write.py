"""Atomic writes: a file is replaced completely or not at all."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from secrets import token_hex
from tempfile import mkdtemp

from knitlab.io.errors import CannotWrite, Fault

UNFINISHED = ".writing-"  # prefix of unfinished files, or of their folders


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
        raise _cannot_write(path, error) from error
    finally:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)


def write_atomically(path: Path, contents: bytes) -> None:
    """Replace a small file by known contents, faster than by a folder; CannotWrite as above."""
    temporary = path.parent / f"{UNFINISHED}{token_hex(8)}"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(contents)
        temporary.replace(path)
    except OSError as error:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise _cannot_write(path, error) from error


def clear_unfinished(folder: Path) -> None:
    """Remove unfinished files of killed processes from a folder and its subfolders."""
    for unfinished in (*folder.glob(f"{UNFINISHED}*"), *folder.glob(f"*/{UNFINISHED}*")):
        if unfinished.is_dir():
            shutil.rmtree(unfinished, ignore_errors=True)
        else:
            unfinished.unlink(missing_ok=True)


def _cannot_write(path: Path, error: OSError) -> CannotWrite:
    why = (error.strerror or str(error)).lower()
    remedy = "free some space" if "space" in why or "quota" in why else "choose another folder"
    return CannotWrite(
        [Fault(str(path), f"cannot be written ({why}); {remedy}; the previous file is unchanged")]
    )
