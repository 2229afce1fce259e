"""A new draft and the edits of its author: each key of a TOML file, each record of a table."""

import tomllib

import pytest

from aeromatch.drafting.merging import edited_records, is_other_flight, merge_manoeuvres, merge_toml
from aeromatch.drafting.project_files import ProjectFiles

DRAFT = """# head
[imu]
p = "P"   # roll
q = "Q"

[engine]
engine1.n1 = "N1"   # speed

[[fit]]
name = "pitch"
records = ["a"]
"""


@pytest.mark.parametrize(
    ("own", "new", "merged", "kept"),
    [
        # the draft alone changes, adds or drops
        (("",), ('"P"', '"P2"'), ("imu", "p", "P2"), ()),
        (("",), ('q = "Q"', 'q = "Q"\nr = "R"'), ("imu", "r", "R"), ()),
        (("",), ('q = "Q"\n', ""), ("imu", "q", None), ()),
        # the author alone changes, adds or removes
        (('"Q"', '"mine"'), ("",), ("imu", "q", "mine"), ()),
        (('q = "Q"', 'q = "Q"\nr = "mine"'), ("",), ("imu", "r", "mine"), ()),
        (('q = "Q"\n', ""), ("",), ("imu", "q", None), ()),
        # both
        (('"Q"', '"mine"'), ('"Q"', '"Q2"'), ("imu", "q", "mine"), ("imu.q",)),
        (('q = "Q"\n', ""), ('"Q"', '"Q2"'), ("imu", "q", None), ("imu.q",)),
        (('"Q"', '"mine"'), ('"P"', '"P2"'), ("imu", "p", "P2"), ()),
    ],
)
def test_keys(own, new, merged, kept):
    own_text = DRAFT.replace(*own) if len(own) == 2 else DRAFT
    new_text = DRAFT.replace(*new) if len(new) == 2 else DRAFT
    result = merge_toml(DRAFT, own_text, new_text)
    table, key, value = merged
    assert tomllib.loads(result.text)[table].get(key) == value
    assert result.kept == kept


def test_comments_of_the_author_stay():
    own = DRAFT.replace('q = "Q"', 'q = "mine"   # measured on 4 May')
    result = merge_toml(DRAFT, own, DRAFT.replace('"P"', '"P2"'))
    assert 'q = "mine"   # measured on 4 May' in result.text


def test_fits_are_merged_by_their_name():
    own = DRAFT.replace('["a"]', '["a", "mine"]')
    new = DRAFT + '\n[[fit]]\nname = "roll"\nrecords = ["b"]\n'
    fits = tomllib.loads(merge_toml(DRAFT, own, new).text)["fit"]
    assert {fit["name"]: fit["records"] for fit in fits} == {"pitch": ["a", "mine"], "roll": ["b"]}
    (fit,) = tomllib.loads(merge_toml(new, new, DRAFT).text)["fit"]
    assert fit["name"] == "pitch"


def test_without_a_known_draft_nothing_of_the_author_changes():
    own = '[imu]\np = "mine"\n'
    merged = tomllib.loads(merge_toml("", own, DRAFT).text)
    assert merged["imu"] == {"p": "mine", "q": "Q"}


TABLE = "record,kind,control,start,end\na,doublet,elevator,1,2\nb,doublet,rudder,3,4\n"


def test_records_of_a_table():
    own = TABLE.replace("1,2", "1,2.5")
    new = TABLE.replace("3,4", "3,5") + "c,pulse,aileron,6,7\n"
    assert edited_records(TABLE, own) == {"a"}
    result = merge_manoeuvres(TABLE, own, new)
    assert result.text == own.replace("3,4", "3,5") + "c,pulse,aileron,6,7\n"
    assert result.kept == ()
    both = merge_manoeuvres(TABLE, own, TABLE.replace("1,2", "1,9"))
    assert both.text == own
    assert both.kept == ("a",)


COLUMNS = "# Columns without a quantity:\n#   E1: its heading is not known\n#   Event: text\n"


@pytest.mark.parametrize(
    "place",
    [
        "# Columns",  # above the comment about columns
        "#   Event",  # in the place of its lines
        "",  # below it, at the end of the file
    ],
)
def test_tables_of_the_author_stay_around_the_comment_about_columns(tmp_path, place):
    drafted = '[imu]\np = "P"   # roll\n\n' + COLUMNS
    mine = '[controls]\ndelta_e = { column = "E1", sign = -1 }   # mine\n'
    own = drafted.replace(place, mine + place) if place else f"{drafted}\n{mine}"
    new = drafted.replace("#   E1: its heading is not known\n", "")
    with ProjectFiles(tmp_path) as files:
        files.write("names.toml", drafted)
    (tmp_path / "names.toml").write_text(own)
    with ProjectFiles(tmp_path) as files:
        files.write("names.toml", new)
    merged = (tmp_path / "names.toml").read_text()
    assert mine in merged
    assert tomllib.loads(merged) == tomllib.loads(own)
    assert "E1: its" not in merged
    assert merged.endswith("#   Event: text\n")
    # A further draft changes nothing.
    with ProjectFiles(tmp_path) as files:
        files.write("names.toml", new)
    assert (tmp_path / "names.toml").read_text() == merged


def test_a_table_that_the_draft_drops_is_reported_if_it_was_edited():
    own = DRAFT.replace('"P"', '"mine"')
    result = merge_toml(DRAFT, own, DRAFT.partition("[engine]")[0].partition("[imu]")[0])
    assert tomllib.loads(result.text)["imu"]["p"] == "mine"
    assert result.kept == ("imu",)


@pytest.mark.parametrize(
    ("old", "new", "other"),
    [('record = "a"', 'record = "b"', True), ("[1, 2]", "[1, 3]", True), ("t = 1", "t = 2", False)],
)
def test_a_case_of_another_flight(old, new, other):
    case = '[case]\nrecord = "a"\nwindow = [1, 2]\nt = 1\n'
    assert is_other_flight(case, case.replace(old, new)) is other
