"""The page: one file, whole in itself, that no text of a cube can break."""

import json
import re
from html.parser import HTMLParser
from importlib.resources import files

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

import knitlab as kl
from knitlab.cli import main
from knitlab.figures.explorer.explorer import PREFIX, as_script_data, page_text
from tests.figures.explorer.conftest import HOSTILE, PREVIEW

MODULES = {
    file.name.removesuffix(".js"): file.read_text()
    for file in files("knitlab.figures.explorer").joinpath("page").iterdir()
    if file.name.endswith(".js")
}
IMPORT = re.compile(r'import \{ ([^}]+) \} from "explorer/(\w+)";')


class Elements(HTMLParser):
    """Every element with its attributes, and the text of the scripts."""

    def __init__(self, text):
        super().__init__()
        self.found, self.scripts = [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))

    def handle_data(self, data):
        if self.found and self.found[-1][0] == "script":
            self.scripts.append(data.strip())


@given(st.dictionaries(st.text(), st.text() | st.none() | st.integers()))
def test_content_is_read_back_as_it_was(content):
    text = as_script_data(content)
    assert json.loads(text) == content
    assert not set(text) & set("<>&\u2028\u2029")


def test_hostile_text_adds_no_element():
    harmless, hostile = (Elements(page_text(text, {"title": text})) for text in ("x", HOSTILE))
    assert [tag for tag, _ in hostile.found] == [tag for tag, _ in harmless.found]
    assert HOSTILE in json.loads(hostile.scripts[0])["title"]


def test_nothing_is_asked_for(page):
    elements = Elements(page.read_text())
    addresses = [
        attributes[name]
        for _, attributes in elements.found
        for name in ("src", "href", "action", "data")
        if name in attributes
    ]
    assert addresses == []
    (policy,) = (each["content"] for _, each in elements.found if each.get("http-equiv"))
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe" not in policy


def test_every_import_is_of_a_name_that_a_module_exports():
    imports = [found for text in MODULES.values() for found in IMPORT.findall(text)]
    assert len(imports) > 40
    for names, module in imports:
        for name in names.split(", "):
            declared = (
                rf"export (async )?(function\*?|class|const) {name}\b|export {{[^}}]*\b{name}\b"
            )
            assert re.search(declared, MODULES[module]), f"{module} exports no {name}"


def test_every_module_is_reached_from_the_first():
    reached, waiting = set(), {"main"}
    while waiting:
        name = waiting.pop()
        reached.add(name)
        waiting |= {module for _, module in IMPORT.findall(MODULES[name])} - reached
    assert reached == set(MODULES)


def test_no_module_writes_html():
    for name, text in MODULES.items():
        assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write", text), name


def test_the_modules_are_in_the_page(page):
    (imports,) = (
        json.loads(text) for text in Elements(page.read_text()).scripts if '"imports"' in text[:12]
    )
    assert set(imports["imports"]) == {f"{PREFIX}{name}" for name in MODULES}


def test_the_command_writes_what_the_function_writes(tmp_path, page):
    output = tmp_path / "command.html"
    said = CliRunner().invoke(main, ["explore", str(PREVIEW), "-o", str(output)])
    assert said.exit_code == 0
    assert said.stdout == f"page    {output}\n"
    assert output.read_bytes() == page.read_bytes()


@pytest.mark.parametrize(
    ("cubes", "name", "problem"),
    [
        ([], "page.html", "cubes"),
        ([PREVIEW], "page.pdf", ".html"),
        (["nowhere"], "page.html", "nowhere"),
    ],
)
def test_bad_input_is_refused(cubes, name, problem, tmp_path):
    with pytest.raises(kl.InputError, match=re.escape(problem)):
        kl.explore(*cubes, output=tmp_path / name)
    assert not any(tmp_path.iterdir())
