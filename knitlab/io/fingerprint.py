"""Fingerprints of the code that computes results, and of files; provenance. Needs no JAX."""

import ast
import hashlib
import platform
import subprocess
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path

from knitlab.io.shipped import PACKAGE

MODEL_VERSION = 1
"""Version of the model. Raise it by one where results change on purpose: all are stale then.

A changed number, operator, message or name in :data:`COMPUTING` makes results stale without a new
version. What changes results and is not in :func:`normalised` code needs one: another version of a
library, or a type of a field by which pydantic converts its value.
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
"""Modules of these that compute nothing of a case."""
DIGITS = 12
LIBRARIES = ("equinox", "jax", "jaxlib", "netCDF4", "numpy", "scipy", "xarray")
NOT_EXECUTED = {"annotation", "returns", "type_comment", "ctx", "kind", "simple"}
"""Fields of nodes that hold annotations, or repeat what the place of the node says."""
BLOCKS = {"body", "orelse", "finalbody"}


@cache
def code_fingerprint() -> str:
    """Fingerprint of the code that computes a case, and of the version of the model."""
    return fingerprint_of(PACKAGE)


@cache
def package_fingerprint() -> str:
    """Fingerprint of the text of the whole package."""
    digest = hashlib.sha256()
    for file in sorted(PACKAGE.rglob("*.py")):
        digest.update(file.relative_to(PACKAGE).as_posix().encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()[:DIGITS]


def fingerprint_of(package: Path) -> str:
    """Fingerprint of the computing code of the package in a folder."""
    code = [
        f"{name}\n{normalised((package / name).read_text(encoding='utf-8'))}"
        for name in computing_files(package)
    ]
    return text_fingerprint("\n".join([f"model version {MODEL_VERSION}", *code]))


def computing_files(package: Path) -> list[str]:
    """Paths, within a package, of the modules that compute the numbers of a case."""
    files = [file for folder in COMPUTING for file in (package / folder).glob("*.py")]
    return sorted({file.relative_to(package).as_posix() for file in files} - set(OF_NO_CASE))


def text_fingerprint(text: str) -> str:
    """Fingerprint of a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def file_digest(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits; OSError if it cannot be read."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def digests(paths: Iterable[Path]) -> dict[str, str]:
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

    def git(*words: str) -> str:
        command = ["git", "-C", str(PACKAGE), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        tracked = git("ls-files", "--error-unmatch", str(PACKAGE / "__init__.py"))
        changed = git("status", "--porcelain", "--untracked-files=no", str(PACKAGE))
        return git("rev-parse", "HEAD") + ("+changes" if changed else "") if tracked else "unknown"
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def normalised(source: str) -> str:
    """The syntax tree of a module as text, without what is not executed or empty."""
    module = _Module()
    body = module.text(ast.parse(source))
    imports = sorted(text for name, text in module.imports if name is None or name in module.used)
    return "\n".join([*imports, body])


class _Module:
    """Text of the nodes of one module, and its imports."""

    def __init__(self) -> None:
        # Each with its name; None if it may also be there for its effect, or for other modules.
        self.imports: list[tuple[str | None, str]] = []
        # Names that are executed, and texts, such as those of ``__all__``.
        self.used: set[object] = set()

    def text(self, value: object) -> str:
        """Text of a node, of a list of nodes, or of a plain value."""
        if isinstance(value, list):
            return f"[{', '.join(map(self.text, value))}]"
        if isinstance(value, ast.Constant):
            self.used.add(value.value)
            return ascii(value.value)
        if not isinstance(value, ast.AST):
            return ascii(value)
        if isinstance(value, ast.Name):
            self.used.add(value.id)
        return f"{type(value).__name__}({', '.join(self._parts(value))})"

    def _parts(self, node: ast.AST) -> Iterator[str]:
        for name, value in ast.iter_fields(node):
            if name in BLOCKS and isinstance(value, list):
                yield f"{name}=[{', '.join(self._statements(value, node))}]"
            elif name not in NOT_EXECUTED and value is not None and value != []:
                yield f"{name}={self.text(value)}"

    def _statements(self, block: list[ast.stmt], inside: ast.AST) -> Iterator[str]:
        for statement in block:
            match statement:
                case ast.Pass() | ast.Expr(value=ast.Constant()):
                    pass
                case ast.If(test=ast.Name(id="TYPE_CHECKING")):
                    yield from self._statements(statement.orelse, inside)
                case ast.Import() | ast.ImportFrom() if isinstance(inside, ast.Module):
                    self._note_imports(statement)
                case ast.AnnAssign() if not isinstance(inside, ast.ClassDef):
                    if statement.value is not None:
                        yield self.text(ast.Assign([statement.target], statement.value))
                case _:
                    yield self.text(statement)

    def _note_imports(self, statement: ast.Import | ast.ImportFrom) -> None:
        origin = ""
        if isinstance(statement, ast.ImportFrom):
            origin = f"{'.' * statement.level}{statement.module or ''}:"
        for alias in statement.names:
            name = alias.asname or (alias.name if origin and alias.name != "*" else None)
            exported = alias.asname == alias.name
            self.imports.append((None if exported else name, f"{origin}{alias.name} as {name}"))
