"""Fingerprints of the code that computes results, and of files; provenance. Needs no JAX."""

import ast
import hashlib
import platform
import subprocess
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path

from platformdirs import user_cache_path

from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import CannotWrite
from knitlab.io.shipped import PACKAGE
from knitlab.io.text_file import plain_file

MODEL_VERSION = 1
"""Version of the model. Raise it by one where results change on purpose: all are stale then.

A changed number, operator, message or name in :data:`COMPUTING` makes results stale without a new
version. What changes results and is not in :func:`normalised` code needs one: another version of a
library, or a type of a field by which pydantic converts its value.
"""
COMPUTING = ("model", "solvers", "observables")
"""Packages that compute the numbers of a case."""
OF_NO_CASE = (
    "model/compiled_programs.py",
    "model/pure_stripe.py",
    "observables/knit_size.py",
    "model/stripe_covariance.py",
)
"""Modules of these that compute nothing of a case."""
DIGITS = 12
LIBRARIES = ("equinox", "jax", "jaxlib", "netCDF4", "numpy", "scipy", "xarray")
NOT_EXECUTED = {"annotation", "returns", "type_comment", "ctx", "kind", "simple"}
"""Fields of nodes that hold annotations, or repeat what the position of the node says."""
BLOCKS = {"body", "orelse", "finalbody"}


@cache
def code_fingerprint() -> str:
    """Fingerprint of the code that computes a case, and of the version of the model.

    To parse the code takes a third of a second; the user's cache folder keeps the fingerprint for
    the text of the package, with a checksum of both.
    """
    text = package_fingerprint()
    kept = user_cache_path("knitlab") / "fingerprints" / text
    with suppress(OSError, UnicodeError):
        known, _, checksum = plain_file(kept).read_text(encoding="utf-8").partition(" ")
        if checksum == text_fingerprint(text + known):
            return known
    computed = fingerprint_of(PACKAGE)
    with suppress(CannotWrite), atomic_write(kept) as temporary:
        checksum = text_fingerprint(text + computed)
        temporary.write_text(f"{computed} {checksum}", encoding="utf-8")
    return computed


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
    text = f"model version {MODEL_VERSION}"
    for name in computing_files(package):
        text += f"\n{name}\n{normalised((package / name).read_text(encoding='utf-8'))}"
    return text_fingerprint(text)


def computing_files(package: Path) -> list[str]:
    """Paths, within a package, of the modules that compute the numbers of a case."""
    files = [file for folder in COMPUTING for file in (package / folder).rglob("*.py")]
    return sorted({file.relative_to(package).as_posix() for file in files} - set(OF_NO_CASE))


def text_fingerprint(text: str) -> str:
    """Fingerprint of a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def file_digest(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits; OSError if it cannot be read."""
    with plain_file(path).open("rb") as file:
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
        git("ls-files", "--error-unmatch", str(PACKAGE / "__init__.py"))
        changed = git("status", "--porcelain", "--untracked-files=no", str(PACKAGE))
        return git("rev-parse", "HEAD") + ("+changes" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def normalised(source: str) -> str:
    """The syntax tree of a module as text, without what is not executed or empty.

    Left out are docstrings, annotations but for those of the fields of classes, and imports of
    which no name is used; the others are sorted.
    """
    module = ast.parse(source)
    for node in ast.walk(module):
        for field, value in ast.iter_fields(node):
            if field in BLOCKS and isinstance(value, list):
                setattr(node, field, list(_executed(value, node)))
            elif field in NOT_EXECUTED:
                setattr(node, field, None)
    imports = [each for each in module.body if isinstance(each, ast.Import | ast.ImportFrom)]
    module.body = [each for each in module.body if each not in imports]
    # Names, and texts, such as those of ``__all__``.
    used = {
        each.id if isinstance(each, ast.Name) else each.value
        for each in ast.walk(module)
        if isinstance(each, ast.Name | ast.Constant)
    }
    lines = []
    for statement in imports:
        origin = ""
        if isinstance(statement, ast.ImportFrom):
            origin = f"{'.' * statement.level}{statement.module or ''}:"
        for alias in statement.names:
            name = alias.asname or (alias.name if origin and alias.name != "*" else None)
            # Others may be there for their effect, or for other modules.
            if name is None or name in used or alias.asname == alias.name:
                lines.append(f"{origin}{alias.name} as {name}")
    return "\n".join([*sorted(lines), _text(module)])


def _executed(block: list[ast.stmt], inside: ast.AST) -> Iterator[ast.stmt]:
    """The statements of a block that are executed, without annotations of variables."""
    for statement in block:
        match statement:
            case ast.Pass() | ast.Expr(value=ast.Constant()):
                pass
            case ast.If(test=ast.Name(id="TYPE_CHECKING")):
                yield from _executed(statement.orelse, inside)
            case ast.AnnAssign(value=value) if not isinstance(inside, ast.ClassDef):
                if value is not None:
                    yield ast.Assign([statement.target], value)
            case _:
                yield statement


def _text(value: object) -> str:
    """Text of a node, of a list of nodes, or of a plain value, in every version of Python."""
    if isinstance(value, list):
        return f"[{', '.join(map(_text, value))}]"
    if not isinstance(value, ast.AST):
        return ascii(value)
    if isinstance(value, ast.Constant):
        return ascii(value.value)
    fields = [
        f"{field}={_text(each)}"
        for field, each in ast.iter_fields(value)
        if each is not None and (each != [] or field in BLOCKS)
    ]
    return f"{type(value).__name__}({', '.join(fields)})"
