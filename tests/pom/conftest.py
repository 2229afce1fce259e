import pytest

TEXT = """
[case]
id = "{id}"
name = "a_case"
title = "A case"
record = "record.nc"
window = [1.0, 9.0]
{case}
[drive]
engine = "thrust"
{more}
"""


@pytest.fixture
def write_case(tmp_path):
    """Write a case file beside an empty record and return its path."""

    def write(id="2.c.10", case="", more=""):
        (tmp_path / "record.nc").touch()
        path = tmp_path / "case.toml"
        path.write_text(TEXT.format(id=id, case=case, more=more))
        return path

    return write
