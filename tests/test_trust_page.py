"""Every threat of the page on trust names what stops it, and tests that exist."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_each_threat_names_a_file_of_tests():
    page = (ROOT / "docs" / "trust.md").read_text()
    table = page.partition("## Threats and tests")[2].partition("\n## ")[0]
    rows = [line for line in table.splitlines() if line.startswith("| ")][1:]
    assert len(rows) > 25
    tests: list[str] = []
    for row in rows:
        cells = [cell.strip() for cell in row.strip("|").split(" | ")]
        assert len(cells) == 4, row
        assert all(cells), row
        # "same" means the file of the row above
        if cells[3] != "same":
            tests = re.findall(r"`(tests/\S+\.py)`", cells[3])
        assert tests, row
        for name in tests:
            assert "\ndef test_" in (ROOT / name).read_text(), row
