"""The notebooks of docs/notebooks run from their first cell to their last."""

import json
import os
import pathlib
import sys

import nbclient
import nbformat
import pytest

NOTEBOOKS = sorted(pathlib.Path("docs/notebooks").glob("*.ipynb"))


def test_there_are_three():
    assert len(NOTEBOOKS) == 3


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(file, tmp_path):
    # A kernel of this environment, whatever kernels the machine knows.
    kernel = tmp_path / "share" / "jupyter" / "kernels" / "python3"
    kernel.mkdir(parents=True)
    (kernel / "kernel.json").write_text(json.dumps(
        {"argv": [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"],
         "display_name": "Python 3", "language": "python"}))
    os.environ["JUPYTER_PATH"] = str(tmp_path / "share" / "jupyter")
    notebook = nbformat.read(file, as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells)  # what a run shows is not kept
    nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    shown = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert any("<img" in str(output.get("data", {}).get("text/html", "")) for output in shown)
    if out := os.environ.get("VISCERA_NOTEBOOKS"):
        nbformat.write(notebook, pathlib.Path(out) / file.name)
