"""Fingerprints: of the code that computes results, and of files. Needs no JAX."""

import hashlib
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

from knitlab.io.shipped import PACKAGE

COMPUTING = (
    "model",
    "linalg",
    "elasticity",
    "contact",
    "solvers",
    "mechanics",
    "dynamics",
    "measure",
    "capacitance",
    "simulation",
    "io/case_file.py",
    "io/classic_file.py",
)
"""Parts of the package whose text can change the numbers of a case."""
OF_CUBES = ("measure/knit_size.py",)
"""Files of these that affect the cube but no case file."""
DIGITS = 12


@lru_cache(maxsize=1)
def code_fingerprint() -> str:
    """Fingerprint of the code that computes a case."""
    return fingerprint_of(PACKAGE)


@lru_cache(maxsize=1)
def package_fingerprint() -> str:
    """Fingerprint of all code of the package."""
    return _fingerprint(PACKAGE, sorted(_names(PACKAGE, PACKAGE.rglob("*.py"))))


def fingerprint_of(package: Path) -> str:
    """Fingerprint of the computing code of the package in a folder."""
    return _fingerprint(package, computing_files(package))


def _fingerprint(package: Path, names: Iterable[str]) -> str:
    digest = hashlib.sha256()
    for name in names:
        digest.update(name.encode())
        digest.update((package / name).read_bytes())
    return digest.hexdigest()[:DIGITS]


def _names(package: Path, files: Iterable[Path]) -> set[str]:
    return {file.relative_to(package).as_posix() for file in files}


def computing_files(package: Path) -> list[str]:
    """Paths, within a package, of the files whose text can change the numbers of a case."""
    files = [
        file
        for part in COMPUTING
        for file in ([package / part] if part.endswith(".py") else (package / part).glob("*.py"))
    ]
    return sorted(_names(package, files) - set(OF_CUBES))


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
