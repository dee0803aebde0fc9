"""The page of claims, as Markdown or HTML: what a user may rely on, by which margin, with figures.

Near misses are separate from claims that fail by more.
"""

import base64
import html
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path
from string import ascii_uppercase
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from knitlab.figures.drawing import draw_figure
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import BadInput, Fault, fault
from knitlab.validation.claims import TOPICS
from knitlab.validation.judgement import Judgement, contrary, summary
from knitlab.validation.margin import GOOD, NEAR, Grade, signed
from knitlab.validation.samples import JudgedSamples

SUFFIXES = (".md", ".html")
TITLE = "The paper's claims"
Key = tuple[str, tuple[Path, ...]]
"""Kind of figure and cubes, which identify the figure of a claim."""
STYLE = """
body { font: 15px/1.4 sans-serif; margin: 2em auto; max-width: 90em; padding: 0 1em; }
p, ul { max-width: 60em; } table { border-collapse: collapse; } img { max-width: 100%; }
td, th { padding: .3em .6em; text-align: left; vertical-align: top; border-bottom: 1px solid #ccc; }
td:first-child { font-weight: bold; white-space: nowrap; }
.holds td:first-child { color: #00664b; } .fails td:first-child { color: #a63603; }
.near-miss td:first-child { color: #8a6100; }
"""
EXPLAINED = (
    "A margin says how far a claim is from its threshold: it holds at 0 and above, and fails below."
    f" The scale is the threshold itself, or the spread of what is compared: {-NEAR:+g} misses a"
    " limit by a quarter of it. A claim about many designs has the margin of the worst of them."
    f" From {GOOD:+g} on the margin is good; from {-NEAR:+g} to 0 the claim is a near miss."
)
OPENINGS = {
    "good": "You may rely on this",
    "reserved": "This holds with a good margin, but designs are missing or another cube disagrees",
    "narrow": "This holds, but only just",
    "near": "Be careful, this is narrowly missed",
    "gross": "Do not rely on this",
    "not measured": "Nothing is known here about this",
}
HEADINGS = {
    Grade.holds: "What holds",
    Grade.near_miss: f"Near misses: they fail by at most {NEAR:g}",
    Grade.fails: f"What fails by more than {NEAR:g}",
    Grade.not_measured: "What was not measured",
}
FIGURE = "figure"
"""Column of the name of a claim's figure."""
WHY_NOT = "why not, as far as it is known"
"""Column of claims that fail."""


def introduction(judgements: Sequence[Judgement]) -> dict[str, list[tuple[str, str]]]:
    """Which claims a user may rely on: pairs of an assessment and its claims, topic by topic."""
    topics: dict[str, list[tuple[str, str]]] = {}
    for topic, (group, opening) in product(TOPICS, OPENINGS.items()):
        claims = [
            _quoted(one)
            for one in judgements
            if one.claim.topic == topic and reliance(one) == group
        ]
        if claims:
            topics.setdefault(topic, []).append((opening, "; ".join(claims) + "."))
    return topics


def reliance(one: Judgement) -> str:
    """The reliability of a claim, a name of :data:`OPENINGS`: good if nothing speaks against it."""
    result = one.result
    if result.margin is None:
        return "not measured"
    if result.grade is not Grade.holds:
        return "near" if result.grade is Grade.near_miss else "gross"
    if result.margin < GOOD:
        return "narrow"
    return "reserved" if one.contrary or result.judged < result.wanted else "good"


def _quoted(one: Judgement) -> str:
    result = one.result
    notes = [
        signed(result.margin),
        result.count if result.judged < result.wanted else "",
        f"but it {contrary(one.contrary, cube_name)}" if one.contrary else "",
    ]
    shown = ", ".join(filter(None, notes))
    return f"“{one.claim.quoted}”" + (f" ({shown})" if shown else "")


def cube_name(path: Path) -> str:
    """The short name of a cube: the last two parts of its path, or of the path of its folder."""
    parts = path.resolve().parts
    parts = parts[:-1] if path.name == "cube.nc" else parts
    return "/".join(parts[-2:]).removesuffix(".nc")


def _row(one: Judgement, letters: Mapping[str, str]) -> dict[str, str]:
    """The cells of a claim by the heading of their column; letters stand for model options."""

    def described(sample: JudgedSamples) -> str:
        letter = letters.get(sample.options)
        size = f"{sample.size} unit cells" if sample.size else ""
        options = f"options {letter}" if letter else ""
        texts = cube_name(sample.cube), sample.experiment, sample.boundary, size, options
        return ", ".join(filter(None, texts))

    claim, result = one.claim, one.result
    judged_on = [result.count, *map(described, one.samples)]
    if one.contrary:
        judged_on.append(f"but it {contrary(one.contrary, cube_name)}")
    cells = {
        "margin": signed(result.margin),
        "what the paper says": claim.text,
        "along": claim.measured_along or "",
        "where": claim.place,
        "what was measured": result.text,
        "judged on": "" if result.margin is None else "; ".join(judged_on),
        "threshold": "; ".join(filter(None, [f"{claim.threshold_of}'s", one.sensitivity])),
        FIGURE: claim.figure or "",
    }
    failing = result.grade in (Grade.near_miss, Grade.fails)
    return cells | ({WHY_NOT: claim.why_not or ""} if failing else {})


class Format(NamedTuple):
    """How plain and marked text, links and tables are written.

    Marks are the tags of HTML: h1 to h3, p, b and ul, of which the text has one item on each line.
    """

    text: Callable[[str], str]
    marked: Callable[[str, str], str]
    link: Callable[[str, str], str]
    table: Callable[[str, list[list[str]]], str]


def _marked_in_markdown(tag: str, text: str) -> str:
    marks = {"p": "{}", "b": "**{}**", "ul": "- {}", "h1": "# {}", "h2": "## {}", "h3": "### {}"}
    return "\n".join(map(marks[tag].format, text.splitlines()))


def _marked_in_html(tag: str, text: str) -> str:
    if tag == "ul":
        text = "".join(f"<li>{item}</li>" for item in text.splitlines())
    return f"<{tag}>{text}</{tag}>"


def _markdown_table(_: str, rows: list[list[str]]) -> str:
    lines = [" | ".join(cell.replace("|", "\\|") for cell in cells) for cells in rows]
    head, *body = (f"| {line} |" for line in lines)
    return "\n".join([head, f"|{'---|' * len(rows[0])}", *body])


def _html_table(name: str, rows: list[list[str]]) -> str:
    lines = ["<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>" for cells in rows]
    lines[0] = lines[0].replace("td>", "th>")
    return "\n".join([f'<table class="{name}">', *lines, "</table>"])


MARKDOWN = Format(str, _marked_in_markdown, "[{0}]({1})".format, _markdown_table)
HTML = Format(html.escape, _marked_in_html, '<a href="{1}">{0}</a>'.format, _html_table)


def check_suffix(page: Path) -> None:
    """Check the format of a page.

    Raises:
        BadInput: if its suffix is of no known format.
    """
    if page.suffix.lower() not in SUFFIXES:
        raise fault(f"output {page}", f"has no suffix of {', '.join(SUFFIXES)}; give one")


def write_page(
    judgements: Sequence[Judgement], page: Path, selections: Mapping[str, Any] = {}
) -> tuple[list[Path], list[Fault]]:
    """Write the claims as a page, Markdown or HTML by its suffix.

    An HTML page is one file with embedded figures; those of a Markdown page are in a folder beside
    it. Returned are the files, and why some figures could not be drawn.

    Raises:
        BadInput: if the suffix is of no known format.
    """
    check_suffix(page)
    if page.suffix.lower() == ".md":
        folder = page.with_suffix("")
        figures, faults = _draw_figures(judgements, folder, selections)
        links = {key: f"{folder.name}/{path.name}" for key, path in figures.items()}
        with atomic_write(page) as temporary:
            parts = _parts(judgements, MARKDOWN, links)
            temporary.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
        return [page, *figures.values()], faults
    with TemporaryDirectory() as drawn:
        figures, faults = _draw_figures(judgements, Path(drawn), selections)
        links = {key: f"#figure-{number}" for number, key in enumerate(figures, start=1)}
        parts = [*_parts(judgements, HTML, links), *(["<h2>Figures</h2>"] if figures else [])]
        parts += [_embedded(key, links[key], path) for key, path in figures.items()]
        head = f'<meta charset="utf-8"><title>{TITLE}</title><style>{STYLE}</style>'
        text = "\n".join([f'<!doctype html><html lang="en">{head}', *parts, "</html>\n"])
        with atomic_write(page) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return [page], faults


def _parts(judgements: Sequence[Judgement], form: Format, links: Mapping[Key, str]) -> list[str]:
    """The parts of a page from its title to its last table, with links to figures."""
    samples = [sample for one in judgements if one.result.at for sample in one.samples]
    options = dict.fromkeys(sample.options for sample in samples if sample.options)
    names = ("".join(each) for count in (1, 2) for each in product(ascii_uppercase, repeat=count))
    letters = dict(zip(options, names, strict=False))
    parts = [
        ("h1", TITLE),
        ("p", form.text(summary(judgements))),
        ("h2", "What you may rely on, and what not"),
        ("p", form.text(EXPLAINED)),
    ]
    for topic, sentences in introduction(judgements).items():
        items = [f"{form.marked('b', f'{head}:')} {form.text(said)}" for head, said in sentences]
        parts += [("h3", form.text(topic.capitalize())), ("ul", "\n".join(items))]
    written = [form.marked(tag, text) for tag, text in parts]
    for grade, heading in HEADINGS.items():
        rows: list[list[str]] = []
        for one in judgements:
            if one.result.grade is grade:
                cells = {name: form.text(text) for name, text in _row(one, letters).items()}
                link = links.get(_key(one))
                cells[FIGURE] = form.link(cells[FIGURE], link) if link else ""
                rows = [*(rows or [list(cells)]), list(cells.values())]
        if rows:
            table = form.table(grade.value.replace(" ", "-"), rows)
            written += [form.marked("h2", form.text(heading)), table]
    if letters:
        items = [f"{letter}: {form.text(text)}" for text, letter in letters.items()]
        written += [form.marked("h2", "Model options"), form.marked("ul", "\n".join(items))]
    return written


def _key(one: Judgement) -> Key:
    return one.claim.figure or "", one.cubes


def _draw_figures(
    judgements: Sequence[Judgement], folder: Path, selections: Mapping[str, Any]
) -> tuple[dict[Key, Path], list[Fault]]:
    """Draw the figures of claims that were measured, or say why some cannot be drawn."""
    files: dict[Key, Path] = {}
    faults: list[Fault] = []
    keys = [_key(one) for one in judgements if one.result.margin is not None and one.claim.figure]
    for kind, cubes in dict.fromkeys(keys):
        label = cube_name(cubes[0]).replace("/", "-")
        name = f"{label}-{kind}.png" if len(cubes) == 1 else f"{kind}.png"
        try:
            files[kind, cubes] = draw_figure(kind, cubes, folder / name, selections)
        except BadInput as error:
            faults += [Fault(f"figure {kind}", entry.problem) for entry in error.faults]
    return files, faults


def _embedded(key: Key, link: str, path: Path) -> str:
    """A figure within an HTML page."""
    kind, cubes = key
    caption = html.escape(f"{kind}: {', '.join(map(cube_name, cubes))}")
    content = base64.b64encode(path.read_bytes()).decode("ascii")
    return (
        f'<figure id="{link.removeprefix("#")}"><figcaption>{caption}</figcaption>'
        f'<img alt="{caption}" src="data:image/png;base64,{content}"></figure>'
    )
