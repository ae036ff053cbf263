"""Run the cells of docs/notebook.ipynb again and keep what they print and show: `python docs/make_notebook.py`.

Takes minutes where the scene of the notebook has not been run yet, else seconds.
"""
import os
from pathlib import Path

import nbformat
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).with_name("notebook.ipynb")


def executed(folder: Path, **changed: str) -> nbformat.NotebookNode:
    """Return the notebook with its outputs, run in a folder.

    Parameters
    ----------
    changed : replace texts in its cells, as name="value" at the beginning of a line.
    """
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    for cell in notebook.cells:
        for name, value in changed.items():
            lines = cell.source.split("\n")
            cell.source = "\n".join(f'{name} = "{value}"' if line.startswith(f"{name} = ") else line for line in lines)
    client = NotebookClient(notebook, record_timing=False, resources={"metadata": {"path": str(folder)}}, timeout=None)
    client.execute(env=os.environ | {"PYTHONPATH": str(folder)})
    for cell in notebook.cells:
        outputs = [one for one in cell.get("outputs", ()) if one.get("name") != "stderr"]  # what libraries warn of
        for one in outputs:
            if "image/jpeg" in one.get("data", ()):
                one.data.pop("image/png", None)  # a photograph, and a third of the size
        if "outputs" in cell:
            cell.outputs = outputs
    return notebook


if __name__ == "__main__":
    nbformat.write(executed(NOTEBOOK.parents[1]), NOTEBOOK)
