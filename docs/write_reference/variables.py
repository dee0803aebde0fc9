"""The reference of variables, from the registry of the cube."""

from markdown_text import code, table

from knitlab.observables.observable import Variable
from knitlab.observables.schema import COORDINATES, FLAGS, VARIABLES


def page() -> str:
    """Every coordinate and variable, kind by kind."""
    parts = ["## Coordinates", _table(COORDINATES)]
    for group in dict.fromkeys(each.group for each in VARIABLES.values()):
        members = {name: each for name, each in VARIABLES.items() if each.group == group}
        parts += [f"## {group.title}", _table(members)]
    parts.append("## Flags")
    for name, flags in FLAGS.items():
        rows = [(code(flag.value), code(flag.name)) for flag in flags]
        parts += [f"Values of `{name}`:", table(("value", "meaning"), rows)]
    return "\n\n".join(parts)


def _table(members: dict[str, Variable]) -> str:
    rows = [
        (
            code(name),
            each.long_name,
            "" if each.units == "1" else each.units,
            ", ".join(code(dim) for dim in each.dims if dim != name),
            each.description + ("" if each.in_cube else " (in case files only)"),
        )
        for name, each in members.items()
    ]
    return table(("name", "meaning", "unit", "dimensions", "details"), rows)
