"""The reference of variables, from the registry of the cube."""

from generated_reference.markdown import code, table
from knitlab.observables.schema import COORDINATES, FLAGS, VARIABLES, Variable

GROUPS = {
    "all": "Every case",
    "design": "The sample",
    "stripes": "Stripe parameters",
    "cloth": "Sizes in cloth",
    "patches": "Shape of the relaxed fabric",
    "sensitivities": "Sensitivities",
    "robustness": "Spread over siblings",
    "capacitor": "Capacitors",
    "unloading": "Capacitors while unloading",
    "stripe": "Pure stripes",
    "dynamics": "Dynamics",
    "laboratory": "Experiments",
}
"""Headings of the kinds of variables, in the order of the page."""


def page() -> str:
    """Every coordinate and variable, kind by kind."""
    kinds = [
        *GROUPS,
        *dict.fromkeys(each.of for each in VARIABLES.values() if each.of not in GROUPS),
    ]
    parts = ["## Coordinates", _table(COORDINATES)]
    for kind in kinds:
        members = {name: each for name, each in VARIABLES.items() if each.of == kind}
        parts += [f"## {GROUPS.get(kind, kind)}", _table(members)]
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
