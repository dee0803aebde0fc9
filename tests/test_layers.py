"""The layers of the package: each imports only from those before it, without circles."""

import ast
from pathlib import Path

import pytest

from knitlab.io.shipped import PACKAGE

LAYERS = (
    "io",
    "model",
    "solvers",
    "observables",
    "cubes",
    "sensors",
    "runs",
    "lab",
    "design",
    "export",
    "claims",
    "figures",
    "api",
    "cli",
)


def layers_imported(file: Path) -> set[str]:
    modules: list[str] = []
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert not node.level, f"{file}: relative import"
            modules.append(node.module or "")
        elif isinstance(node, ast.Import):
            modules += [alias.name for alias in node.names]
    return {name.split(".")[1] for name in modules if name.startswith("knitlab.")}


def test_every_package_is_a_layer():
    assert {path.parent.name for path in PACKAGE.glob("*/__init__.py")} == set(LAYERS)


@pytest.mark.parametrize("layer", LAYERS)
def test_a_layer_imports_only_from_those_before_it(layer):
    allowed = set(LAYERS[: LAYERS.index(layer) + 1])
    later = {
        file.name: layers_imported(file) - allowed
        for file in (PACKAGE / layer).rglob("*.py")
        if layers_imported(file) - allowed
    }
    assert not later
