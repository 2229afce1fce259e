"""Run the notebooks of the documentation and keep tables and figures in them:
``python docs/scripts/make_notebooks.py``.

Figures are kept with few colours, and nothing is kept that differs from run to run: counts, times,
paths. `log.ulg` of the notebook of a UAV is a flight of the T-37 as a PX4 autopilot logs it
(`tests/flighttest/recorders/px4_flight.py`).
"""

from __future__ import annotations

import base64
import io
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from PIL import Image

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "docs" / "tutorials").glob("*.ipynb"))
# Colours of a figure: lines, texts and their soft edges.
_COLOURS = 32


def write_inputs(folder: Path) -> None:
    """Write the log that the notebook of a UAV reads."""
    sys.path.insert(0, str(ROOT / "tests" / "flighttest"))
    from recorders import px4_flight  # only the tests write logs

    px4_flight.write(folder / "log.ulg")


def run_notebook(file: Path, folder: Path) -> Any:
    """Return an executed notebook."""
    notebook = nbformat.read(file, as_version=4)
    client = NotebookClient(
        notebook, timeout=3000, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    )
    client.execute()
    return notebook


def keep_results(notebook: Any) -> None:
    """Remove all outputs but tables and figures, and all counts."""
    for cell in notebook.cells:
        cell.metadata = {}
        if cell.cell_type != "code":
            continue
        cell.execution_count = None
        results = [output for output in cell.outputs if output.output_type == "execute_result"]
        for output in results:
            output.execution_count, output.metadata = None, {}
            if "image/png" in output.data:
                output.data["image/png"] = reduce_colours(output.data["image/png"])
        cell.outputs = results
    notebook.metadata.language_info = {"name": "python"}


def reduce_colours(encoded: str) -> str:
    """Return a picture in base64 with few colours."""
    picture = Image.open(io.BytesIO(base64.b64decode(encoded))).convert("RGB")
    reduced = io.BytesIO()
    picture.quantize(_COLOURS).save(reduced, "png", optimize=True)
    return base64.b64encode(reduced.getvalue()).decode()


def main() -> None:
    """Run all notebooks, or those named."""
    names = sys.argv[1:]
    os.environ["PYTHONPATH"] = str(ROOT)
    for file in NOTEBOOKS:
        if names and file.stem not in names:
            continue
        with tempfile.TemporaryDirectory() as scratch:
            write_inputs(Path(scratch))
            notebook = run_notebook(file, Path(scratch))
        keep_results(notebook)
        nbformat.write(notebook, file)
        print(f"{file.name}: {file.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
