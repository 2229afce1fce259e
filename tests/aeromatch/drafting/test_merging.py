"""A new draft and the edits of its author: each key of a TOML file, each record of a table."""

import tomllib

import pytest

from aeromatch.drafting.merging import edited_records, merge_manoeuvres, merge_toml

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
