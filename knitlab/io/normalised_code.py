"""Normalised code: what of a Python module can change a number, as text."""

import ast
from collections.abc import Iterator

NOT_EXECUTED = {"annotation", "returns", "type_comment", "ctx", "kind", "simple"}
"""Fields of nodes that hold annotations, or repeat what the place of the node says."""
BLOCKS = {"body", "orelse", "finalbody"}


def normalised(source: str) -> str:
    """The syntax tree of a module as text, without what is not executed.

    Comments, docstrings, layout, spelling of literals, annotations, the order of imports and
    imports of names that only annotations use are left out. Fields of a class are kept, without
    their types. Empty fields of nodes are left out too, because versions of Python differ in them.

    Args:
        source: text of the module.
    """
    module = _Module()
    body = module.text(ast.parse(source))
    imports = sorted(text for name, text in module.imports if name is None or name in module.used)
    return "\n".join([*imports, body])


class _Module:
    """Text of the nodes of one module.

    Attributes:
        imports: text of each import of the module, and the name that it is for; None if it may also
            be there for its effect, or for other modules.
        used: names that are executed, and texts, such as those of ``__all__``.
    """

    def __init__(self) -> None:
        self.imports: list[tuple[str | None, str]] = []
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
