"""Jupyter's kernel executes the notebooks of tutorials, and they draw.

That their cells run in order is also a lint, without Jupyter (tests/lint/test_notebooks.py).
"""
import json
import pathlib
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT/'site'))
import notebooks  # noqa: E402


@pytest.mark.full
@pytest.mark.parametrize('page', notebooks.PAGES)
def test_a_kernel_executes_the_notebook(page, tmp_path):
    nbformat = pytest.importorskip('nbformat')
    nbclient = pytest.importorskip('nbclient')
    pytest.importorskip('ipykernel')
    notebook = nbformat.reads(json.dumps(notebooks.notebook(page)), as_version=4)
    nbclient.NotebookClient(notebook, timeout=300, kernel_name='python3', resources={
        'metadata': {
            'path': str(tmp_path)
        }
    }).execute()
    cells = [cell for cell in notebook.cells if cell.cell_type == 'code']
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell.outputs]
    assert any(output.output_type == 'stream' and output.name == 'stdout' for output in outputs)
    assert not any('Warning: ' in output.get('text', '') for output in outputs)
    if 'draw' in cells[-1].source:
        assert sum('image/png' in output.get('data', {}) for output in cells[-1].outputs) == 1
