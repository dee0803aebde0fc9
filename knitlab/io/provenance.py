"""Provenance: the code and libraries that computed a result."""

import platform
import subprocess
from functools import lru_cache
from importlib.metadata import version

from knitlab.io.shipped import PACKAGE

LIBRARIES = ("equinox", "jax", "jaxlib", "netCDF4", "numpy", "scipy", "xarray")


@lru_cache(maxsize=1)
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

    def git(*words: str) -> str:
        command = ["git", "-C", str(PACKAGE), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        tracked = git("ls-files", "--error-unmatch", str(PACKAGE / "__init__.py"))
        changed = git("status", "--porcelain", "--untracked-files=no", str(PACKAGE))
        return git("rev-parse", "HEAD") + ("+changes" if changed else "") if tracked else "unknown"
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
