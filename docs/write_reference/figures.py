"""The gallery of figures: each kind, with code that draws it from a kept cube."""

from collections.abc import Iterator

from markdown_text import first_paragraph

from knitlab.figures.registry import figure_kind
from knitlab.runs.figure_names import FIGURE_NAMES

EXAMPLES = {
    "auxetic": "preview",
    "capacitors": "sensor",
    "contact": "sensor_contact",
    "curves": "small_samples",
    "cycles": "cycles",
    "directions": "directions",
    "electrodes": "sensor, n_stripe=4, n_subunit=16",
    "force": "preview",
    "grid": 'periodic, x="applied_strain", y="periods", of="poisson_ratio", n_stripe=8',
    "options": "options",
    "polar": "periodic, n_stripe=4, n_subunit=16, applied_strain=0.15",
    "relaxation": "folding",
    "samples": "preview, n_stripe=4, n_subunit=16",
    "sensitivity": "acrylic",
    "sensor": "sensor",
    "shape": "preview, n_stripe=4, n_subunit=16, applied_strain=0.15",
    "stripes": "stripes",
    "swept": 'sensor_layouts, of="sensitivity"',
    "tension": "small_samples",
    "uncertainty": 'acrylic, material="docs/examples/swatches/acrylic.toml"',
    "wavelength": "small_samples",
}
"""For each figure: a cube of ``results/reference``, and keyword arguments."""


def page() -> str:
    """For each kind of figure: what it shows and takes, and a cell of code that draws it."""
    return "\n\n".join(part for name in FIGURE_NAMES for part in _section(name))


def _section(name: str) -> Iterator[str]:
    kind = figure_kind(name)
    facts = [f"Takes {kind.takes}."]
    if kind.dims:
        facts.append(f"Designs along {' and '.join(f'`{dim}`' for dim in kind.dims)}.")
    if kind.needs:
        facts.append(f"Needs `{kind.needs}`, which is in case files.")
    cube, _, keywords = EXAMPLES[name].partition(", ")
    arguments = ", ".join(filter(None, ["cube", keywords]))
    yield f"## {name}"
    yield first_paragraph(kind.summary)
    yield " ".join(facts)
    opened = f'cube = kl.open_cube("results/reference/{cube}")'
    yield f"```{{code-cell}}\n{opened}\nkl.plot.{name}({arguments})\n```"
