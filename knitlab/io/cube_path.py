"""The file of a cube, and what was meant by a path that has none. Imports no library."""

from pathlib import Path

from knitlab.io.errors import InputError, invalid

CUBE = "cube.nc"
MAX_NEAR = 3  # cubes that a message names


def cube_path(path: str | Path) -> Path:
    """The file of a cube, given this file or its folder."""
    path = Path(path)
    return path / CUBE if path.is_dir() else path


def is_cube(path: str | Path) -> bool:
    """Whether a path is that of a cube or of a test, and not of a workflow."""
    return Path(path).suffix == ".nc" or (Path(path) / CUBE).is_file()


def no_cube(path: str | Path) -> InputError:
    """The error of a path without a cube, which names those that may be meant."""
    path = Path(path)
    near = sorted(file.parent for file in path.glob(f"*/{CUBE}"))
    if (path.parent / "results" / path.name / CUBE).is_file():
        near = [path.parent / "results" / path.name]
    message = f"has no {CUBE}" if path.is_dir() else "does not exist"
    if not near:
        return invalid(str(path), f"{message}; run a workflow or import an experiment first")
    more = f" or another of {len(near)} folders" if len(near) > MAX_NEAR else ""
    return invalid(str(path), f"{message}; give {' or '.join(map(str, near[:MAX_NEAR]))}{more}")
