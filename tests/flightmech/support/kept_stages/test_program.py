"""What decides the last bit: every file of every package, settings of the arithmetic."""

from importlib.metadata import EntryPoint

import pytest

from flightmech.support.kept_stages import program


@pytest.fixture
def forgotten():
    yield
    program.hash_installation.cache_clear()
    program.hash_arithmetic.cache_clear()


def test_every_file_of_every_package_counts(tmp_path, monkeypatch, forgotten):
    (tmp_path / "some_package" / "deep").mkdir(parents=True)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(program, "PACKAGES", ("some_package",))
    found = []
    files = (
        ("__init__.py", ""),
        ("deep/a.py", "x = 1"),
        ("deep/a.py", "x = 2"),
        ("kernel.so", "code"),
        ("page.html", "<p>"),
    )
    for name, text in (
        *files,
        ("notes.md", "words"),
        (".hidden", "words"),
        ("deep/b.pyc", "compiled"),
    ):
        (tmp_path / "some_package" / name).write_text(text)
        program.hash_installation.cache_clear()
        found.append(program.hash_installation())
    assert len(set(found)) == 5
    assert set(found[5:]) == {found[4]}  # words and what Python compiles decide nothing


def test_another_kernel_of_linear_algebra_is_another_arithmetic(monkeypatch, forgotten):
    found = []
    for core in ("Haswell", "Zen"):
        monkeypatch.setenv("OPENBLAS_CORETYPE", core)
        program.hash_arithmetic.cache_clear()
        found.append(program.hash_arithmetic())
    assert found[0] != found[1]


@pytest.mark.parametrize("file", ["reader.py", "reader/deep.py"])
def test_the_sources_of_a_reader_of_another_package_count(tmp_path, monkeypatch, forgotten, file):
    (tmp_path / file).parent.mkdir(exist_ok=True)
    if "/" in file:
        (tmp_path / "reader" / "__init__.py").touch()
    points = [EntryPoint("fdr", "reader:read", program.RECORD_READERS)]
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(
        program, "entry_points", lambda group: points if group == program.RECORD_READERS else []
    )
    found = []
    for text in ("x = 1", "x = 2"):
        (tmp_path / file).write_text(text)
        program.hash_installation.cache_clear()
        found.append(program.hash_installation())
    assert found[0] != found[1]
    assert "fdr reader:read" in found[0]
