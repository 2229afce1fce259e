"""The JSON schema of case files: of one mind with the reader about what a case may hold."""

import json
from pathlib import Path

import jsonschema
import pytest

from flightmech.errors import SchemaError
from flightmech.support.toml_files import read_toml
from pom.cases.case import read_case
from pom.cases.case_file import CaseFile, CaseTable, DriveTable, LoopTable, case_schema

T37 = Path(__file__).parents[3] / "data" / "t37" / "cases"


def test_every_key_is_explained():
    schema = case_schema()
    for table in (
        schema,
        *(schema["$defs"][model.__name__] for model in (CaseTable, DriveTable, LoopTable)),
    ):
        unexplained = [
            key
            for key, item in table["properties"].items()
            if not item.get("description") and "$ref" not in item
        ]
        assert unexplained == []
    assert set(schema["properties"]) == set(CaseFile.model_fields)


def test_an_editor_knows_the_words_of_the_tolerance_table():
    schema = case_schema()
    assert {"2.c.10", "2.d(7)", "1.b.1"} <= set(
        schema["$defs"]["CaseTable"]["properties"]["id"]["enum"]
    )
    assert {"input_end", "capture", "200ft_agl"} <= set(
        schema["properties"]["events"]["properties"]
    )
    assert (
        schema["properties"]["conditions"]["properties"]["delta_f"]["description"]
        == "flap deflection [rad], or a text with its unit"
    )


@pytest.mark.slow
@pytest.mark.parametrize("file", sorted(T37.rglob("*.toml")), ids=lambda file: file.stem)
def test_shipped_cases_fit(file):
    jsonschema.validate(json.loads(json.dumps(read_toml(file))), case_schema())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "more"),
    [
        ('windw = "x"', ""),
        ('reference = "flght"', ""),
        ("fraction = 1.5", ""),
        ('features = ["reversible_control"]', ""),
        ("", '[conditions]\ndelta_x = "1 deg"'),
        ("", "[events]\ninput_stop = 3.0"),
        ("", "[tolerance]\ntheta = { percnt = 3 }"),
        ("", "[rationale]\ntheta = 3"),
        ("", '[[drive.pilot]]\ncontrol = "delta_a"\nchannel = "phi"\ngain = 1.0'),
    ],
)
def test_schema_and_reader_refuse_the_same_mistakes(write_case, case, more):
    path = write_case(case=case, more=more)
    with pytest.raises(SchemaError):
        read_case(path)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(read_toml(path), case_schema())
