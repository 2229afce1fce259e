"""Files of a folder that `init` does not read, and headings that two columns share."""

import zipfile

import numpy as np
import pytest

from aeromatch.drafting.name_map.names import draft_names
from aeromatch.drafting.sources import sources_of
from flightmech.errors import SchemaError

TIME = np.arange(0.0, 20.0, 0.02)
BANK, OTHER = 5.0 * np.sin(TIME), 3.0 * np.cos(0.3 * TIME)


def write_csv(file, **columns):
    """Write columns under headings in which ``_`` and a number at the end are left out."""
    heads = [name.partition("_")[0] for name in columns]
    table = np.column_stack(list(columns.values()))
    np.savetxt(file, table, "%.6g", ",", header=",".join(heads), comments="")
    return file


def test_archives_and_workbooks_of_a_folder_are_named(tmp_path):
    write_csv(tmp_path / "a.csv", Time=TIME, Bank=BANK)
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
        archive.writestr("monday.csv", "Time,Bank")
    with zipfile.ZipFile(tmp_path / "c.xlsx", "w") as archive:
        archive.writestr("xl/workbook.xml", "")
    (tmp_path / "d.txt").write_text("Time,Bank")
    (tmp_path / "photo.png").write_bytes(b"\x89PNG")
    sources = sources_of([], [tmp_path])
    assert [file.name for file in sources.records] == ["a.csv"]
    packed, workbook, text = sources.ignored
    assert packed.startswith("b.zip is not read: a zip archive (monday.csv)")
    assert workbook.startswith("c.xlsx is not read: an Excel workbook")
    assert "--records d.txt" in text


def test_a_folder_of_nothing_but_archives_names_them(tmp_path):
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
        archive.writestr("monday.csv", "Time,Bank")
    with pytest.raises(SchemaError) as caught:
        sources_of([], [tmp_path])
    assert "b.zip" in caught.value.problems[1]


def test_two_columns_of_one_heading_wait_for_the_author(tmp_path):
    file = write_csv(tmp_path / "a.csv", Time=TIME, Bank_1=BANK, Bank_2=OTHER, Roll=BANK + 0.01)
    draft = draft_names([file])
    (row,) = draft.rows
    assert (row.channel.column, row.confidence) == ("Bank.1", "CONFIRM")
    assert "Bank.2 may be phi as well and has other values" in row.reason
    # The column that moves with it is a second reading and no contradiction.
    assert "Roll" not in row.reason
    copies = write_csv(tmp_path / "b.csv", Time=TIME, Bank_1=BANK, Bank_2=BANK)
    (row,) = draft_names([copies]).rows
    assert (row.channel.column, row.confidence) == ("Bank", "by size")


def test_a_folder_without_recordings_is_named(tmp_path):
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "a.md").write_text("wind calm")
    (tmp_path / "deck.inp").write_text("CASEID A\n")
    (remark,) = sources_of([tmp_path / "deck.inp"], [tmp_path / "notes"]).ignored
    assert remark.startswith(f"no recording is in {tmp_path / 'notes'}; it needs files of .csv")


def test_samples_that_share_whole_seconds_get_their_rate(tmp_path):
    file = write_csv(tmp_path / "a.csv", UTC=np.floor(TIME), Bank=BANK, Pitch=OTHER)
    draft = draft_names([file])
    assert draft.clock.rate == 50.0
    assert any("even stamps of 50 Hz; CONFIRM" in text for text in draft.remarks)
    # a lost sample in the middle leaves the rate unknown
    (tmp_path / "b.csv").write_text(
        "".join(
            line
            for number, line in enumerate(file.read_text().splitlines(keepends=True))
            if not 210 < number < 230
        )
    )
    with pytest.raises(SchemaError, match="no column that rises"):
        draft_names([tmp_path / "b.csv"])


def test_a_table_of_one_row_is_named(tmp_path):
    (tmp_path / "a.csv").write_text("Time,Bank\n0,1\n")
    with pytest.raises(SchemaError, match="1 row"):
        draft_names([tmp_path / "a.csv"])


def test_files_of_several_systems_of_a_flight_are_named(tmp_path):
    files = [
        write_csv(tmp_path / "1_ins.csv", Time=TIME, Bank=BANK),
        write_csv(tmp_path / "1_adc.csv", Time=TIME, KCAS=OTHER),
    ]
    with pytest.raises(SchemaError) as caught:
        draft_names(files)
    (problem,) = caught.value.problems
    assert problem.startswith("1_ins.csv and 1_adc.csv have no column in common besides the clock")
    assert "join the files of each flight by their clock" in problem


def test_a_load_factor_in_g_is_the_accelerometer(tmp_path):
    file = tmp_path / "flight.csv"
    text = ["Uhrzeit;nz [g];Variometer [ft/min]"]
    text += [
        f"09:41:{t:06.3f};{1.0 + 0.01 * x:.4f};{x:.2f}" for t, x in zip(TIME, BANK, strict=True)
    ]
    file.write_text("\n".join(text).replace(".", ","))
    rows = {row.name: row.channel for row in draft_names([file]).rows}
    assert rows.keys() == {"az_imu", "hdot"}
    assert (rows["az_imu"].column, rows["az_imu"].sign) == ("nz", -1)
