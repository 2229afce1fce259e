"""Names of files that every system allows, and figures whose bytes do not depend on the time."""

import pytest

from flightmech.support.figures import new_figure, write_figure
from flightmech.support.foreign_code.portable_names import is_portable_name


@pytest.mark.parametrize("name", ["README.md", "a b", "null.csv", "com.txt", "é.nc"])
def test_plain_names(name):
    assert is_portable_name(name)


@pytest.mark.parametrize("name", ["", "nul", "NUL.csv", "com1.txt", "a:b", "a/b", "a\\b", "a\0"])
def test_names_that_some_system_does_not_allow(name):
    assert not is_portable_name(name)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["svg", "pdf", "png"])
def test_a_figure_has_the_same_bytes_when_written_again(tmp_path, kind):
    pytest.importorskip("matplotlib")
    for name in ("one", "two"):
        figure = new_figure(2.0, 2.0)
        # a marker and a clipped line get names of their own in SVG
        figure.subplots().plot([0.0, 1.0], [0.0, 1.0], "o-")
        write_figure(figure, tmp_path / f"{name}.{kind}")
    one, two = (tmp_path / f"{name}.{kind}" for name in ("one", "two"))
    assert one.read_bytes() == two.read_bytes()
    assert b"<dc:date>" not in one.read_bytes()
    assert b"CreationDate" not in one.read_bytes()
