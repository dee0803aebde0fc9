"""Atomic writes: a file is replaced completely or not at all."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import mkdtemp

from knitlab.io.errors import CannotWrite, Fault

UNFINISHED = ".writing-"  # prefix of the folders of unfinished files
PROBE_BYTES = 1 << 20


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
    except (OSError, RuntimeError) as error:
        # On a full disk netCDF may report a missing permission, and HDF5 gives no reason; a plain
        # file does.
        reason = (folder and _refusal(folder)) or error
        if not isinstance(reason, OSError):
            raise
        why = (reason.strerror or str(reason)).lower()
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


def _refusal(folder: Path) -> OSError | None:
    try:
        (folder / "probe").write_bytes(bytes(PROBE_BYTES))
    except OSError as error:
        return error
    return None
