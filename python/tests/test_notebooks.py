"""Notebooks run from the first cell to the last; their own last cell says what must have come out.

WHORL_NOTEBOOKS names a folder that keeps them with their outputs, for the documentation.
"""

import os
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = Path(__file__).resolve().parents[1] / "notebooks"


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebook_runs(path, tmp_path, params, monkeypatch):
    monkeypatch.setenv("WHORL_PARAMS", str(params))
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}).execute()
    if kept := os.environ.get("WHORL_NOTEBOOKS"):
        Path(kept).mkdir(parents=True, exist_ok=True)
        nbformat.write(notebook, Path(kept) / path.name)
    # Results show themselves: tables and pictures.
    kinds = {kind for cell in notebook.cells for output in cell.get("outputs", []) for kind in output.get("data", {})}
    assert {"text/html", "application/vnd.plotly.v1+json"} <= kinds
    # In the repository without its outputs.
    assert not any(cell.get("outputs") for cell in nbformat.read(path, as_version=4).cells)
