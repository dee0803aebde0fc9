"""The page of claims, as Markdown: what a user may rely on, by which margin, with figures."""

import re
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from string import ascii_uppercase
from typing import Any
from urllib.parse import quote

from knitlab.claims.claims import TOPICS
from knitlab.claims.judgement import Judgement, contrary, summary
from knitlab.claims.margin import GOOD, NEAR, Grade, signed
from knitlab.figures.drawing import draw_figure
from knitlab.figures.figure_files import reporting
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import Mistake

Key = tuple[str, tuple[Path, ...]]  # kind of figure and cubes, which identify the figure of a claim
PAPER = (
    "The paper is K. Mahadevan et al., *Folding-Driven Auxetic Weft Knit Textiles with Integrated"
    " Capacitive Sensing*."
)
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
    "not measured": "Not measured here",
}
HEADINGS = {
    Grade.holds: "What holds",
    Grade.near_miss: f"Near misses: they fail by at most {NEAR:g}",
    Grade.fails: f"What fails by more than {NEAR:g}",
    Grade.not_measured: "What was not measured",
}


def introduction(judgements: Sequence[Judgement]) -> dict[str, list[tuple[str, str]]]:
    """Which claims a user may rely on: pairs of an assessment and its claims, topic by topic."""
    topics: dict[str, list[tuple[str, str]]] = {}
    for topic, (group, opening) in product(TOPICS, OPENINGS.items()):
        on_topic = (one for one in judgements if one.claim.topic == topic)
        if claims := [_quoted(one) for one in on_topic if reliance(one) == group]:
            topics.setdefault(topic, []).append((opening, "; ".join(claims) + "."))
    return topics


def reliance(one: Judgement) -> str:
    """The reliability of a claim, a name of :data:`OPENINGS`: good if nothing speaks against it."""
    result = one.result
    if result.margin is None:
        return "not measured"
    if result.margin < GOOD:
        return {Grade.holds: "narrow", Grade.near_miss: "near"}.get(result.grade, "gross")
    return "reserved" if one.contrary or result.judged < result.wanted else "good"


def _quoted(one: Judgement) -> str:
    result = one.result
    count = result.count if result.judged < result.wanted else ""
    contradicted = f"but it {contrary(one.contrary, _shown)}" if one.contrary else ""
    noted = ", ".join(filter(None, (signed(result.margin), count, contradicted)))
    return f"“{one.claim.quoted}” ({noted})" if noted else f"“{one.claim.quoted}”"


def cube_name(path: Path) -> str:
    """The short name of a cube: the last two names of its path, or of the path of its folder."""
    path = path.resolve()
    names = (path.parent if path.name == "cube.nc" else path).parts[-2:]
    return "/".join(names).removesuffix(".nc")


def _shown(path: Path) -> str:
    return _escaped(cube_name(path))


def _escaped(name: str) -> str:
    """A name that Markdown shows as it is."""
    return re.sub(r"([\\`*<>\[\]])", r"\\\1", name)


def _row(one: Judgement, letters: Mapping[str, str], figure: str) -> dict[str, str]:
    """The cells of a claim by the heading of their column, with model options by their letter."""
    claim, result = one.claim, one.result
    judged_on = [result.count]
    for each in one.samples:
        size = f"{each.size} unit cells" if each.size else ""
        options = f"options {letters[each.options]}" if each.options in letters else ""
        named = _shown(each.cube), _escaped(each.experiment), _escaped(each.boundary)
        judged_on.append(", ".join(filter(None, (*named, size, options))))
    if one.contrary:
        judged_on.append(f"but it {contrary(one.contrary, _shown)}")
    cells = {
        "margin": signed(result.margin),
        "what the paper says": claim.text,
        "along": claim.measured_along or "",
        "where": claim.place,
        "what was measured": result.text,
        "judged on": "" if result.margin is None else "; ".join(judged_on),
        "threshold": "; ".join(filter(None, [f"{claim.threshold_of}'s", one.sensitivity])),
        "figure": figure,
    }
    if result.grade in (Grade.near_miss, Grade.fails):
        cells["likely reason"] = claim.why_not or ""
    return cells


def write_page(
    judgements: Sequence[Judgement], page: Path, selections: Mapping[str, Any] = {}
) -> tuple[list[Path], list[Mistake]]:
    """Write the page and its figures in a folder beside it; the files, and what cannot be drawn."""
    folder, figures, mistakes = page.with_suffix(""), dict[Key, Path](), list[Mistake]()
    keys = [_key(one) for one in judgements if one.result.margin is not None and one.claim.figure]
    for kind, cubes in dict.fromkeys(keys):
        label = cube_name(cubes[0]).replace("/", "-")
        name = f"{label}-{kind}.png" if len(cubes) == 1 else f"{kind}.png"
        with reporting(kind, mistakes):
            figures[kind, cubes] = draw_figure(kind, cubes, folder / name, selections)
    links = {key: quote(f"{folder.name}/{path.name}") for key, path in figures.items()}
    with atomic_write(page) as temporary:
        temporary.write_text("\n\n".join(_blocks(judgements, links)) + "\n", encoding="utf-8")
    return [page, *figures.values()], mistakes


def _blocks(judgements: Sequence[Judgement], links: Mapping[Key, str]) -> list[str]:
    """The headings, paragraphs, lists and tables of a page, with links to figures."""
    samples = [sample for one in judgements if one.result.at for sample in one.samples]
    options = dict.fromkeys(sample.options for sample in samples if sample.options)
    names = ("".join(each) for count in (1, 2) for each in product(ascii_uppercase, repeat=count))
    letters = dict(zip(options, names, strict=False))
    blocks = ["# The paper's claims", PAPER, summary(judgements)]
    blocks += ["## What you may rely on, and what not", EXPLAINED]
    for topic, sentences in introduction(judgements).items():
        items = [f"- **{opening}:** {quoted}" for opening, quoted in sentences]
        blocks += [f"### {topic.capitalize()}", "\n".join(items)]
    figures = {key: f"[{key[0]}]({link})" for key, link in links.items()}
    for grade, heading in HEADINGS.items():
        graded = (one for one in judgements if one.result.grade is grade)
        if rows := [_row(one, letters, figures.get(_key(one), "")) for one in graded]:
            blocks += [f"## {heading}", _table(rows)]
    if letters:
        items = [f"- {letter}: {_escaped(text)}" for text, letter in letters.items()]
        blocks += ["## Model options", "\n".join(items)]
    return blocks


def _table(rows: Sequence[Mapping[str, str]]) -> str:
    cells = [list(rows[0]), *(row.values() for row in rows)]
    lines = [" | ".join(cell.replace("|", "\\|") for cell in row) for row in cells]
    head, *body = (f"| {line} |" for line in lines)
    return "\n".join([head, f"|{'---|' * len(rows[0])}", *body])


def _key(one: Judgement) -> Key:
    return one.claim.figure or "", one.cubes
