"""Files that are there whole or not at all."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import mkdtemp

from knitlab.sweep.faults import fault


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Give a temporary path to write to, and put it in place of ``path`` when all went well.

    Raises:
        BadInput: if the folder cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        folder = Path(mkdtemp(prefix=".writing-", dir=path.parent))
    except OSError as error:
        raise fault(
            str(path), f"cannot be written ({error.strerror}); choose another folder"
        ) from error
    try:
        temporary = folder / path.name
        yield temporary
        temporary.replace(path)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
