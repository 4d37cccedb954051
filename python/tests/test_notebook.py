"""Tests of the notebooks."""

from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).parents[1] / "notebooks" / "denoisers.ipynb"


def test_the_notebook_runs(tmp_path):
    for package in ("ipykernel", "matplotlib", "nbclient"):
        pytest.importorskip(package, reason=f"the notebook needs the package {package}")
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(NOTEBOOK, as_version=4)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(cell.outputs == [] and cell.execution_count is None for cell in cells), "outputs are not stripped"
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": tmp_path}}).execute()
    load, bench, *charts = cells
    assert "image/png" in load.outputs[0].data
    lines = bench.outputs[0].text.splitlines()
    assert [line.split()[0] for line in lines] == ["svgf", "bmfr"] * 3
    assert len(charts) == 2 and all("image/png" in chart.outputs[-1].data for chart in charts)
