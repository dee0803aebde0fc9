"""The structure of knitlab in numbers: what a run crosses, what a load touches, how much code.

    python benchmarks/structure.py
    python benchmarks/structure.py --skip-run

Run it before and after a change of structure and compare the two tables. A run of one design of
``preview`` is traced in this process, so that it takes a minute or two.
"""

import argparse
import ast
import itertools
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import knitlab as kl

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = Path(kl.__file__).parent
DESIGN: dict[str, Any] = {"n_stripe": 4, "n_subunit": 16}
LOAD_KINDS = {"biaxial", "shear", "off_axis"}  # "warp" and "weft" also name directions


class Trace:
    """Calls of knitlab's own functions, recorded by a profiler of this thread.

    Attributes:
        functions: named functions, as (file, first line), in the order of their first calls.
        calls: how often each was called.
        depth: the largest number of knitlab's frames on the stack at once.
    """

    def __init__(self) -> None:
        self.functions: list[tuple[str, int]] = []
        self.names: dict[tuple[str, int], str] = {}
        self.calls: dict[tuple[str, int], int] = {}
        self.depth = self._now = 0

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        """Record a call or a return, as ``sys.setprofile`` reports it."""
        code = frame.f_code
        if event not in ("call", "return") or not code.co_filename.startswith(str(PACKAGE)):
            return
        self._now += 1 if event == "call" else -1
        self.depth = max(self.depth, self._now)
        if event == "return" or code.co_name.startswith("<"):
            return
        key = code.co_filename, code.co_firstlineno
        if key not in self.calls:
            self.functions.append(key)
            self.names[key] = code.co_name
        self.calls[key] = self.calls.get(key, 0) + 1

    def table(self) -> dict[str, int | str]:
        """The numbers of the trace, by what they count."""
        packages = [package_of(Path(file)) for file, _ in self.functions]
        repeated = sorted(self.calls, key=self.calls.__getitem__, reverse=True)[:5]
        most = (f"{self.names[key]} {self.calls[key]:,}" for key in repeated)
        return {
            "functions that the run crosses": len(self.functions),
            "files that the run crosses": len({file for file, _ in self.functions}),
            "packages that the run crosses": len(set(packages)),
            "changes of package between first calls": sum(
                before != after for before, after in itertools.pairwise(packages)
            ),
            "deepest stack of own frames": self.depth,
            "most frequent calls": ", ".join(most),
        }


def package_of(file: Path) -> str:
    """The package of a file of knitlab, or ``knitlab`` itself."""
    parts = file.relative_to(PACKAGE).parts
    return parts[0] if len(parts) > 1 else "knitlab"


def traced_run() -> Trace:
    """The trace of a run of one design of ``preview`` in this process."""
    trace = Trace()
    with tempfile.TemporaryDirectory() as folder:
        sys.setprofile(trace)
        try:
            kl.run("preview", results=folder, workers=0, **DESIGN)
        finally:
            sys.setprofile(None)
    return trace


def modules(folder: Path) -> Iterator[tuple[Path, ast.Module]]:
    """Files of Python in a folder that git tracks, each with its syntax tree."""
    listed = subprocess.run(
        ["git", "ls-files", "*.py"], cwd=folder, check=True, capture_output=True, text=True
    )
    for name in listed.stdout.split():
        yield folder / name, ast.parse((folder / name).read_text(encoding="utf-8"))


def names_a_load(tree: ast.Module) -> bool:
    """Whether a module tells loads apart: by the name of one, or by their ``kind``."""
    return any(
        (isinstance(node, ast.Constant) and node.value in LOAD_KINDS)
        or (
            isinstance(node, ast.Attribute)
            and node.attr == "kind"
            and isinstance(node.value, ast.Name | ast.Attribute)
            and "load" in ast.unparse(node.value)
        )
        for node in ast.walk(tree)
    )


def only_handed_on(function: ast.FunctionDef) -> int:
    """How many parameters of a function it only passes to other calls."""
    arguments = function.args
    parameters = {each.arg for each in [*arguments.args, *arguments.kwonlyargs]} - {"self", "cls"}
    handed_on: dict[str, int] = dict.fromkeys(parameters, 0)
    used: dict[str, int] = dict.fromkeys(parameters, 0)
    for node in ast.walk(function):
        if isinstance(node, ast.Name) and node.id in parameters:
            used[node.id] += 1
        if isinstance(node, ast.Call):
            for each in [*node.args, *(keyword.value for keyword in node.keywords)]:
                if isinstance(each, ast.Name) and each.id in parameters:
                    handed_on[each.id] += 1
    return sum(used[name] == handed_on[name] > 0 for name in parameters)


def code_table() -> dict[str, int]:
    """How much code there is, and how it hangs together."""
    product = dict(modules(PACKAGE))
    tests = [file for file, _ in modules(ROOT / "tests")]
    functions = [
        node
        for tree in product.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
    ]
    return {
        "packages": len({package_of(file) for file in product} - {"knitlab"}),
        "files": len(product),
        "lines of the product": sum(lines(file) for file in product),
        "lines of the tests": sum(lines(file) for file in tests),
        "functions": len(functions),
        "parameters that are only handed on": sum(map(only_handed_on, functions)),
        "files that tell loads apart": sum(
            names_a_load(tree) for file, tree in product.items() if file.parent.name != "loads"
        ),
    }


def lines(file: Path) -> int:
    """Lines of a text file."""
    return len(file.read_text(encoding="utf-8").splitlines())


def main() -> None:
    """Print the table of the run and of the code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--skip-run", action="store_true", help="count the code alone")
    run = {} if parser.parse_args().skip_run else traced_run().table()
    for name, value in (run | code_table()).items():
        print(f"{name:42} {value if isinstance(value, str) else format(value, ',')}")


if __name__ == "__main__":
    main()
