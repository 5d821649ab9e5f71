"""The notebook runs, and still prints what is printed in it."""

import pathlib

import nbformat
from nbclient import NotebookClient

NOTEBOOK = pathlib.Path(__file__).parents[2] / "docs" / "quickstart.ipynb"


def told(notebook):
    """What code cells print, and how many pictures each shows."""
    outputs = [cell.outputs for cell in notebook.cells if cell.cell_type == "code"]
    text = ["".join(o.text for o in all_ if o.output_type == "stream" and o.name == "stdout") for all_ in outputs]
    pictures = [sum("image/png" in o.get("data", {}) for o in all_) for all_ in outputs]
    return text, pictures


def test_the_notebook_is_as_committed():
    committed = told(nbformat.read(NOTEBOOK, as_version=4))
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = []
    NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    assert told(notebook) == committed
    assert any(committed[0]) and sum(committed[1]) == 2
