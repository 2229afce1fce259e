"""Commands that read a file, change it and write it again: another change in the meantime."""

import tomllib

import pandas as pd
import pytest

from aeromatch.project import editing
from flightmech.errors import SchemaError
from flighttest.records import manoeuvre_table

CHANGED = "changed by another program"
NAMES = '[imu]\nq = { column = "Q", unit = "deg/s" }\n'


def test_a_key_is_not_set_over_a_change_of_another(tmp_path, monkeypatch):
    file = tmp_path / "names.toml"
    file.write_text(NAMES)
    change = editing._change_document

    def change_after_another(document, path, key, value):
        file.write_text(NAMES + 'p = { column = "P", unit = "deg/s" }\n')
        return change(document, path, key, value)

    monkeypatch.setattr(editing, "_change_document", change_after_another)
    with pytest.raises(SchemaError, match=CHANGED):
        editing.set_key(file, "imu.r", '{ column = "R", unit = "deg/s" }')
    assert list(tomllib.loads(file.read_text())["imu"]) == ["q", "p"]
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("exists", [True, False])
def test_a_mark_is_not_made_over_that_of_another(tmp_path, monkeypatch, exists):
    table = tmp_path / "marks.csv"
    mark = {"kind": "doublet", "control": "elevator", "start": 1.0, "end": 2.0}
    if exists:
        manoeuvre_table.edit_manoeuvres(table, "a", None, mark)
    write = manoeuvre_table.write_manoeuvres

    def write_after_another(tables, path, before=None):
        rows = pd.DataFrame([{**mark, "manoeuvre": "doublet", "note": "of another"}])
        write({"b": rows}, path)
        write(tables, path, before)

    monkeypatch.setattr(manoeuvre_table, "write_manoeuvres", write_after_another)
    with pytest.raises(SchemaError, match=CHANGED):
        manoeuvre_table.edit_manoeuvres(table, "a", None, {**mark, "start": 1.5})
    monkeypatch.undo()
    assert list(manoeuvre_table.read_manoeuvres(table)) == ["b"]
