"""The notebooks of the documentation run, and print what they show."""

from copy import deepcopy
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = sorted((Path(__file__).parents[2] / "docs" / "notebooks").glob("*.ipynb"))


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_prints_what_it_shows(path, tmp_path):
    shown = nbformat.read(path, as_version=4)
    client = NotebookClient(deepcopy(shown), resources={"metadata": {"path": str(tmp_path)}})
    assert printed(client.execute()) == printed(shown)


def printed(notebook):
    """The text that each cell prints or returns; pictures are left out."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    values = [output.data["text/plain"] for output in outputs if "data" in output]
    return values + [output.text for output in outputs if output.get("name") == "stdout"]
