"""The windows of tables that several threads read."""

from datcom_io.printout import rows


class _Cleared(dict):
    """A dict that another thread clears as soon as somebody has looked for a key."""

    def __contains__(self, key):
        found = super().__contains__(key)
        self.clear()
        return found


def test_windows_survive_a_thread_that_clears_them(monkeypatch):
    """With the interpreter lock no thread was seen to do this; without it one can."""
    table = (rows.PrintedColumn("CL", 2, 7),)
    monkeypatch.setattr(rows, "_WINDOWS_BY_COLUMNS", _Cleared())
    first = rows.cached_column_windows(table, 0)
    assert rows.cached_column_windows(table, 0) is first
    assert first.columns == table
