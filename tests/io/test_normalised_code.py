"""Normalised code changes with what is executed, and with nothing else."""

import ast
import random
import shutil

import pytest
from hypothesis import given
from hypothesis import strategies as st

import knitlab.io.fingerprint as fingerprint_module
from knitlab.io.fingerprint import code_fingerprint, computing_files, fingerprint_of, normalised
from knitlab.io.shipped import PACKAGE

PLAIN = """
import math
import numpy as np

SCALE = 2.5

class Spring:
    stiffness: float
    rest: float = 1.0

    def force(self, length):
        stretch = length - self.rest
        return self.stiffness * stretch if stretch > 0 else np.zeros(1)

def period(spring, mass=1):
    return 2 * math.pi * math.sqrt(mass / spring.stiffness)
"""
SAME = '''
"""A spring."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np  # arrays
import math

if TYPE_CHECKING:
    from pathlib import Path

SCALE: float = 25e-1
"""Of lengths."""


class Spring:
    """A spring
    of one dimension."""

    stiffness: "int"
    """In N/mm."""
    rest: Callable = 1.0

    def force(self, length: float) -> "Path":
        """Its force."""
        stretch: float = (
            length - self.rest  # positive if longer
        )
        unknown: int
        return (self.stiffness * stretch) if (stretch > 0) else np.zeros(0x1)

def period(spring: Spring, mass: int=1) -> float: return (2*math.pi
 * math.sqrt(mass / spring.stiffness))
'''


def test_only_layout_comments_docstrings_and_annotations_differ():
    assert normalised(SAME) == normalised(PLAIN)


@pytest.mark.parametrize(
    ("fragment", "other"),
    [
        ("2.5", "2.6"),
        ("1.0", "1"),
        ("mass=1", "mass=True"),
        ("length - self", "length + self"),
        ("> 0", ">= 0"),
        ("import math", "import cmath as math"),
        ("import numpy as np", "from jax import numpy as np"),
        (
            "    stiffness: float\n    rest: float = 1.0",
            "    rest: float = 1.0\n    stiffness: float",
        ),
        ("    stiffness: float\n", ""),
        ("rest: float = 1.0", "rest = 1.0"),
        ("(mass / spring.stiffness)", "(spring.stiffness / mass)"),
        ("mass=1", "mass"),
        ("2 * math.pi", "(yield) * math.pi"),
        ("def period", "@math.cache\ndef period"),
        ("import math\n", "import math\nimport knitlab.model\n"),
        ("import math\n", "import math\nfrom cmath import sqrt as sqrt\n"),
        ("import math\n", "import math\nfrom cmath import *\n"),
        ("import math\n", "from cmath import sqrt\nimport math\n__all__ = ['sqrt']\n"),
    ],
)
def test_whatever_is_executed_tells_apart(fragment, other):
    assert PLAIN.count(fragment) == 1
    assert normalised(PLAIN.replace(fragment, other)) != normalised(PLAIN)


NAMES = st.sampled_from("abc")
LEAVES = NAMES | st.integers(0, 9).map(str) | st.floats(0, 1e9).map(repr)
TERMS = st.recursive(
    LEAVES,
    lambda inner: st.tuples(inner, st.sampled_from(["+", "-", "*", "/", "@", "<", "and"]), inner),
)


def text_of(term):
    if isinstance(term, str):
        return term
    left, operator, right = term
    return f"({text_of(left)} {operator} {text_of(right)})"


def evaluated(source, **values):
    """Value of an expression, or the kind of error that it raises."""
    try:
        return repr(eval(source, {}, values))
    except (TypeError, ZeroDivisionError, OverflowError) as error:
        return type(error)


@given(TERMS, TERMS)
def test_expressions_that_are_normalised_alike_have_the_same_value(one, other):
    first, second = text_of(one), text_of(other)
    alike = normalised(f"x = {first}") == normalised(f"x = {second}")
    assert alike == (ast.dump(ast.parse(first)) == ast.dump(ast.parse(second)))
    if alike:
        values = {"a": 2.5, "b": -3.25, "c": 7.125}
        assert evaluated(first, **values) == evaluated(second, **values)


@given(TERMS)
def test_expressions_are_normalised_without_their_layout(term):
    source = f"x = {text_of(term)}"
    spaced = source.replace(" ", "  ").replace("(", "( ").replace(")", "\t)") + "  # it"
    assert normalised(source) == normalised(spaced) == normalised(ast.unparse(ast.parse(source)))


@pytest.fixture
def package(tmp_path):
    return shutil.copytree(PACKAGE, tmp_path / "knitlab")


def without_explanations(source):
    """A module without comments, docstrings, layout, and annotations of functions."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(
            node
        ):
            node.body[0] = ast.Pass()
        if isinstance(node, ast.FunctionDef):
            node.returns = None
        if isinstance(node, ast.arg):
            node.annotation = None
    return ast.unparse(tree)


def test_the_package_without_explanations_is_the_same_code(package):
    for name in computing_files(package):
        file = package / name
        file.write_text(without_explanations(file.read_text(encoding="utf-8")), encoding="utf-8")
    assert len({file.stat().st_size for file in package.rglob("*.py")}) > 50
    assert fingerprint_of(package) == code_fingerprint()


class Mutation(ast.NodeTransformer):
    """Changes one number or operator of a module, counted from its beginning."""

    def __init__(self, index):
        self.left = index

    def changed(self, node, other):
        self.left -= 1
        return other if self.left == -1 else node

    def visit_BinOp(self, node):
        self.generic_visit(node)
        swapped = ast.Sub() if isinstance(node.op, ast.Add) else ast.Add()
        return self.changed(node, ast.BinOp(node.left, swapped, node.right))

    def visit_Constant(self, node):
        if type(node.value) not in (int, float):
            return node
        return self.changed(node, ast.Constant(node.value + 1))


def executed(tree):
    """A tree whose annotations, which no mutation may change, are gone."""
    for node in ast.walk(tree):
        if isinstance(node, ast.AnnAssign):
            node.annotation = ast.Name("float")
    return tree


def mutated(source, chosen):
    """A module with one other number or operator; None if it has none."""
    counted = Mutation(-1)
    counted.visit(executed(ast.parse(source)))
    places = -1 - counted.left
    if not places:
        return None
    tree = Mutation(chosen.randrange(places)).visit(executed(ast.parse(source)))
    return ast.unparse(ast.fix_missing_locations(tree))


@pytest.mark.slow
def test_any_changed_number_or_operator_makes_other_code(package):
    chosen, changed = random.Random(0), {}
    for name in chosen.sample(computing_files(PACKAGE), 40):
        source = without_explanations((PACKAGE / name).read_text(encoding="utf-8"))
        if other := mutated(source, chosen):
            assert normalised(other) != normalised(source), name
            changed[name] = other
    assert len(changed) > 20
    for name in chosen.sample(sorted(changed), 3):
        before = (package / name).read_text(encoding="utf-8")
        (package / name).write_text(changed[name], encoding="utf-8")
        assert fingerprint_of(package) != code_fingerprint(), name
        (package / name).write_text(before, encoding="utf-8")
    assert fingerprint_of(package) == code_fingerprint()


def test_another_version_of_the_model_is_other_code(monkeypatch):
    now = code_fingerprint()
    monkeypatch.setattr(fingerprint_module, "MODEL_VERSION", fingerprint_module.MODEL_VERSION + 1)
    assert fingerprint_of(PACKAGE) != now
