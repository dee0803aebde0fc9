"""Fingerprints: of the code that computes results, and of files. Needs no JAX."""

import hashlib
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

from knitlab.io.normalised_code import normalised
from knitlab.io.shipped import PACKAGE

MODEL_VERSION = 1
"""Version of the model. Raise it by one where results change on purpose: all are stale then.

The fingerprint also has the syntax trees of :data:`COMPUTING` without comments, docstrings and
annotations (:mod:`knitlab.io.normalised_code`). A changed number, operator, message or name there
makes results stale without a new version. What changes results and is not in those trees needs one:
another version of a library, or a type of a field by which pydantic converts its value.
"""
COMPUTING = (
    "fabric",
    "equilibrium",
    "equilibrium/linear_algebra",
    "dynamics",
    "measure",
    "measure/capacitance",
    "simulation",
)
"""Packages that compute the numbers of a case."""
OF_NO_CASE = (
    "fabric/compiled_programs.py",
    "measure/calibration.py",
    "measure/fit_statistics.py",
    "measure/knit_size.py",
    "measure/marker_grid.py",
    "measure/records.py",
)
"""Modules of these that compute nothing of a case: they serve measured fabrics and cubes, or keep
programs."""
DIGITS = 12


@lru_cache(maxsize=1)
def code_fingerprint() -> str:
    """Fingerprint of the code that computes a case, and of the version of the model."""
    return fingerprint_of(PACKAGE)


@lru_cache(maxsize=1)
def package_fingerprint() -> str:
    """Fingerprint of the text of the whole package."""
    digest = hashlib.sha256()
    for name in sorted(_names(PACKAGE, PACKAGE.rglob("*.py"))):
        digest.update(name.encode())
        digest.update((PACKAGE / name).read_bytes())
    return digest.hexdigest()[:DIGITS]


def fingerprint_of(package: Path) -> str:
    """Fingerprint of the computing code of the package in a folder."""
    code = [
        f"{name}\n{normalised((package / name).read_text(encoding='utf-8'))}"
        for name in computing_files(package)
    ]
    return text_fingerprint("\n".join([f"model version {MODEL_VERSION}", *code]))


def _names(package: Path, files: Iterable[Path]) -> set[str]:
    return {file.relative_to(package).as_posix() for file in files}


def computing_files(package: Path) -> list[str]:
    """Paths, within a package, of the modules that compute the numbers of a case."""
    files = [file for part in COMPUTING for file in (package / part).glob("*.py")]
    return sorted(_names(package, files) - set(OF_NO_CASE))


def text_fingerprint(text: str) -> str:
    """Fingerprint of a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def file_digest(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits.

    Raises:
        OSError: if it cannot be read.
    """
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def bytes_digest(contents: bytes) -> str:
    """SHA-256 of the contents of a file, in hexadecimal digits."""
    return hashlib.sha256(contents).hexdigest()


def digests(paths: Iterable[Path]) -> dict[str, str]:
    """SHA-256 of files by absolute path; empty for a missing file."""
    return {
        str(path.resolve()): file_digest(path) if path.is_file() else "" for path in sorted(paths)
    }
