"""A report that several files of tests read."""

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # for report_pages
from report_pages import texts, write


@pytest.fixture(scope="package")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    path = write(folder)
    return texts(path.read_text(encoding="utf-8")), json.loads(
        (folder / "results.json").read_text(encoding="utf-8")
    )
