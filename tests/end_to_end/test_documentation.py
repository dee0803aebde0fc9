"""The output shown in the documentation is that of its commands and Python on the kept cubes."""

import doctest
import operator
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from click.testing import CliRunner

import knitlab as kl
from knitlab.claims.claims import read_claims
from knitlab.claims.judgement import judged
from knitlab.cli import main
from knitlab.figures.claims_page import write_page

ROOT = Path(__file__).parents[2]
REFERENCE = ROOT / "results" / "reference"
PAGES = [
    "README.md",
    "CONTRIBUTING.md",
    *(str(path.relative_to(ROOT)) for path in sorted((ROOT / "docs").rglob("*.md"))),
]
READING_COMMANDS = (
    *("query", "find", "knit", "claims", "export", "plate", "sensing", "law", "wear"),
)
"""Commands that only read a cube, whose output can be compared without a simulation."""
JUDGED = ("small_samples", "stripes", "relaxation", "sensor_stripes", "sensor")
"""Kept cubes that the page of claims judges."""
LEFT_OUT = "…"
FILES = ("page ", "figure ", "mesh ", "knitout ", "chart ", "sheet ", "card ", "law ")
"""What begins a line that names a file."""


@dataclass(frozen=True)
class Example:
    """A command that a page shows, and what it prints."""

    page: str
    words: tuple[str, ...]
    printed: tuple[str, ...]

    def __str__(self):
        return f"{self.page}: {' '.join(self.words)}"

    @property
    def left_out(self):
        """Why it is not run, if it is not."""
        return next((why for words, why in NOT_RUN.items() if words in str(self)), "")


def examples(page):
    """Every command of the indented blocks of a page, with the lines below it."""
    found, words, printed = [], None, []
    for line in [*(ROOT / page).read_text(encoding="utf-8").splitlines(), ""]:
        command = re.fullmatch(r"    \$ knitlab (.*)", line)
        if words is not None and (command or not line.startswith("    ")):
            found.append(Example(page, words, tuple(printed)))
            words = None
        if command:
            words, printed = tuple(shlex.split(command[1])), []
        elif words is not None:
            printed.append(line[4:])
    return found


def kept(word):
    """The kept copy of a results folder, if there is one."""
    folder = REFERENCE / Path(word).name
    return str(folder) if word.startswith("results/") and (folder / "cube.nc").exists() else word


def is_kept(example):
    if example.words[0] == "sensing" and "--where" in example.words:
        return False  # of several designs, whose shapes are not kept
    folders = [word for word in example.words[1:] if word.startswith("results/")]
    return bool(folders) and all(kept(f) != f or (ROOT / f).is_dir() for f in folders)


NOT_RUN = {
    "cluster.md": "needs SLURM, or is of no workflow",
    "swatches_across && knitlab": "is that of test_against_measurements.py",
    "doctor": "prints what is known of the machine",
    "resume.md: status": "is of the reader's run",
    "sensing results/sensor --select applied_strain=0.1 --where": "simulates (2, 32) for an hour",
    "import markers DESCRIPTION": "is of the reader's records",
    "import tensile DESCRIPTION": "is of the reader's records",
    "import capacitance DESCRIPTION": "is of the reader's records",
}
"""Commands whose output is not compared, by a part of them, and why."""
PRINTED = [
    example
    for page in PAGES
    for example in examples(page)
    if any(line.strip() and not line.startswith(FILES) for line in example.printed)
]
EXAMPLES = [
    example for example in PRINTED if example.words[0] in READING_COMMANDS and is_kept(example)
]


@pytest.mark.slow
@pytest.mark.parametrize(
    "example",
    [
        pytest.param(
            each, id=str(each), marks=pytest.mark.nightly if each.words[0] == "claims" else ()
        )
        for each in EXAMPLES
    ],
)
def test_a_printed_table_is_that_of_the_kept_cube(example, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    words = [
        str(tmp_path / word) if before in ("-o", "--sheet") else kept(word)
        for before, word in zip(("", *example.words), example.words, strict=False)
    ]
    said = CliRunner().invoke(main, words)
    lines = [line.rstrip() for line in said.output.splitlines()]
    place = 0
    for part in split(example.printed, LEFT_OUT):
        place = start_of(part, lines, place) + len(part)


def split(lines, separator):
    """Runs of lines between separators, without lines that name written files."""
    part = []
    for line in lines:
        if line.strip() == separator:
            yield part
            part = []
        elif not line.startswith(FILES):
            part.append(line.rstrip())
    yield part


def start_of(part, lines, first, same=operator.eq):
    """Where a run of lines begins among others, in the order in which they are printed."""
    for place in range(first, len(lines) - len(part) + 1):
        if all(map(same, part, lines[place : place + len(part)])):
            return place
    raise AssertionError("not printed:\n" + "\n".join(part) + "\n\nbut:\n" + "\n".join(lines))


@pytest.mark.slow
@pytest.mark.nightly
def test_the_first_row_of_the_readme_is_computed_again(tmp_path):
    query = next(example for example in examples("README.md") if example.words[0] == "query")
    heading, first, *_ = query.printed
    names, values = re.sub(r" \[[^]]*\]", "", heading).split(), first.split()
    pairs = zip(names, values, strict=False)  # a row without marks ends before
    printed = {name: float(value) for name, value in pairs if name != "marks"}
    sizes = {name: int(printed.pop(name)) for name in ("n_stripe", "n_subunit")}
    computed = kl.run("preview", **sizes, results=tmp_path).squeeze()
    assert {name: float(computed[name]) for name in printed} == pytest.approx(printed, rel=1e-3)


@pytest.mark.slow
def test_the_page_of_claims_is_that_of_the_kept_cubes(tmp_path):
    cubes = [REFERENCE / name for name in JUDGED]
    write_page(judged(read_claims(), cubes), tmp_path / "claims.md")
    kept_page = (REFERENCE / "claims.md").read_text(encoding="utf-8")
    assert (tmp_path / "claims.md").read_text(encoding="utf-8") == kept_page


BLOCK = re.compile(r"^```(python|pycon)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def python_of(page):
    """The blocks of Python on a page that are to be run, and whether each is a session."""
    return BLOCK.findall((ROOT / page).read_text(encoding="utf-8"))


LONG = {
    *("docs/how-to/calibrate.md", "docs/how-to/design.md", "docs/how-to/shape.md"),
    "docs/how-to/uncertainty.md",
    *("docs/tutorials/elbow.md", "docs/tutorials/sleeve.md"),
}
"""Pages whose Python takes long, and is tested nightly."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=pytest.mark.nightly if page in LONG else ())
        for page in PAGES
        if python_of(page) and page != "README.md"
    ],
)
def test_the_python_of_a_page_runs_and_prints_what_it_shows(page, monkeypatch):
    monkeypatch.chdir(ROOT)
    run_python_of(page)


@pytest.mark.slow
def test_the_python_of_the_readme_runs(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)  # it simulates and writes
    run_python_of("README.md")
    assert (tmp_path / "shape.png").is_file()


def run_python_of(page):
    names = {}
    for kind, code in python_of(page):
        if kind == "python":
            exec(compile(code, page, "exec"), names)
            continue
        session = doctest.DocTestParser().get_doctest(code, names, page, page, 0)
        runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
        assert not runner.run(session, clear_globs=False).failed
        names = session.globs


SIMULATED = {each.page for each in PRINTED if each not in EXAMPLES and not each.left_out}
"""Pages that print more than tables of kept cubes."""


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("page", sorted(SIMULATED - {"README.md"}))  # its run is the first sweep's
def test_a_page_prints_what_its_commands_print(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for folder in ("docs", "workflows"):
        Path(folder).symlink_to(ROOT / folder)
    Path("rib.txt").write_text(". .\n. .\n", encoding="utf-8")
    made = {example.words[1] for example in examples(page) if example.words[0] == "run"}
    for folder in REFERENCE.iterdir():
        if folder.is_dir() and folder.name not in made:
            shutil.copytree(folder, Path("results") / folder.name)
    Path("results/reference").symlink_to(REFERENCE)
    last = max(number for number, each in enumerate(examples(page)) if each in PRINTED)
    for example in examples(page)[: last + 1]:
        if example.left_out:
            continue
        said = CliRunner().invoke(main, list(example.words))
        said_lines = [line.rstrip() for line in said.output.splitlines()]
        lines = [line for line in said_lines if not line.startswith(FILES)]
        place = 0
        for part in split(example.printed, LEFT_OUT):
            place = start_of(part, lines, place, alike) + len(part)


def alike(one, other):
    """Whether lines have the same words, and numbers within 5 %."""
    words = zip(re.split(r"[\s,:]+", one), re.split(r"[\s,:]+", other), strict=False)
    same_count = len(one.split()) == len(other.split())
    return same_count and all(a == b or near(a, b) for a, b in words)


def near(one, other):
    """Whether words are numbers within 5 %."""
    try:
        return float(one.strip("±%×()")) == pytest.approx(float(other.strip("±%×()")), rel=0.05)
    except ValueError:
        return False


@pytest.mark.parametrize("page", [page for page in PAGES if examples(page)])
def test_the_commands_of_a_page_have_the_options_that_it_shows(page):
    for example in examples(page):
        command = main.commands[example.words[0]]
        known = {name for option in command.params for name in option.opts + option.secondary_opts}
        shown = {word.split("=")[0] for word in example.words if re.match("-[a-z-]", word)}
        assert shown <= known, example


def test_the_reference_is_that_of_the_code(tmp_path):
    writer = [sys.executable, "docs/write_reference", str(tmp_path)]
    subprocess.run(writer, cwd=ROOT, check=True)
    written = {page.name: page.read_text(encoding="utf-8") for page in tmp_path.iterdir()}
    kept = {name: (ROOT / "docs/reference" / name).read_text("utf-8") for name in written}
    stale = [name for name in written if written[name] != kept[name]]
    assert len(written) > 4
    assert not stale, "run: python docs/write_reference"


def test_the_workflow_of_the_guide_can_be_planned(tmp_path, monkeypatch):
    page = (ROOT / "docs/how-to/write_workflow.md").read_text("utf-8")
    monkeypatch.chdir(tmp_path)
    Path("wide.toml").write_text(re.findall(r"```toml\n(.*?)```", page, re.DOTALL)[0], "utf-8")
    done = CliRunner(catch_exceptions=False).invoke(main, ["plan", "wide.toml"])
    assert done.exit_code == 0, done.output
