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
        # On a full disk netCDF and HDF5 report something else; a plain file gives the reason.
        reason = _refusal(folder) if folder is not None else None
        if reason is None and isinstance(error, OSError):
            reason = error
        if reason is None:
            raise
        raise _cannot_write(path, reason) from error
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


def _cannot_write(path: Path, error: OSError) -> CannotWrite:
    why = (error.strerror or str(error)).lower()
    remedy = "free some space" if "space" in why or "quota" in why else "choose another folder"
    return CannotWrite(
        [Fault(str(path), f"cannot be written ({why}); {remedy}; the previous file is unchanged")]
    )
