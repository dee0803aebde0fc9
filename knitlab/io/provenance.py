"""What is behind a result: the version of the model, the libraries, the files. Needs no JAX."""

import hashlib
import os
import platform
import re
import subprocess
from collections.abc import Iterable
from functools import cache
from importlib.metadata import version
from pathlib import Path

from knitlab.io.shipped import PACKAGE

MODEL_VERSION = 1
"""Version of the model. Raise it by one where results change on purpose: older ones are stale."""
MODEL = f"model {MODEL_VERSION}"
"""The ``code`` of every case that is computed now."""
DIGITS = 12
LIBRARIES = ("equinox", "jax", "jaxlib", "netCDF4", "numpy", "scipy", "xarray")


def stored_model(code: str) -> str:
    """The model of a stored ``code``, which earlier versions made a hash of their code."""
    return "model 1" if re.fullmatch(r"[0-9a-f]{12}", code) else code


@cache
def package_digest() -> str:
    """Digest of the text of the whole package."""
    digest = hashlib.sha256()
    for file in sorted(PACKAGE.rglob("*.py")):
        digest.update(file.relative_to(PACKAGE).as_posix().encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()[:DIGITS]


def text_digest(text: str) -> str:
    """Digest of a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def file_digest(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits; OSError if it cannot be read."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def file_digests(paths: Iterable[Path]) -> dict[str, str]:
    """SHA-256 of files by absolute path; empty for a missing file."""
    return {str(path.resolve()): file_digest(path) if path.is_file() else "" for path in paths}


@cache
def provenance() -> dict[str, str]:
    """Global attributes that state the code and libraries behind a file, with CF names."""
    return {
        "Conventions": "CF-1.11",
        "source": f"knitlab {version('knitlab')}",
        "git_commit": git_commit(),
        "library_versions": " ".join(f"{name}={version(name)}" for name in LIBRARIES),
        "python_version": platform.python_version(),
        "random_seeds": "none: the simulation is deterministic",
        "references": "Mahadevan et al., Folding-Driven Auxetic Weft Knit Textiles with"
        " Integrated Capacitive Sensing",
    }


def git_commit() -> str:
    """Commit of the source tree, marked if it has changes; ``unknown`` if installed."""
    english = os.environ | {"LC_ALL": "C"}

    def git(*words: str) -> str:
        command = ["git", "-C", str(PACKAGE), *words]
        done = subprocess.run(
            command,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            check=True,
            env=english,
        )
        return done.stdout.strip()

    try:
        git("ls-files", "--error-unmatch", str(PACKAGE / "__init__.py"))
        changed = git("status", "--porcelain", "--untracked-files=no", str(PACKAGE))
        return git("rev-parse", "HEAD") + ("+changes" if changed else "")
    except OSError:
        return "unknown"
    except subprocess.CalledProcessError as error:
        if "dubious ownership" in error.stderr:
            return "unknown: the clone has another owner; allow it by git config safe.directory"
        return "unknown"
