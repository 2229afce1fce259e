"""A manifest states the program that judged; another installation finds an edited table or
module.
"""

import json
from pathlib import Path

import pytest

import pom
from flightmech.support.input_files import file_sha256
from pom.archive.program_files import PROGRAM, TABLE, compare_program, list_program, program_digests
from pom.tolerances import rows

OWN = pom.provenance([], {})["versions"].get(PROGRAM, "")


def statement(changed=(), version=OWN):
    """Return the part of a manifest that states the program, with changed digests."""
    program = {name: "0" * 64 if name in changed else d for name, d in program_digests().items()}
    builder = {
        "version": {PROGRAM: version},
        "builderDependencies": list_program({"program": program}),
    }
    # as read from a file
    return json.loads(json.dumps({"predicate": {"runDetails": {"builder": builder}}}))


def states(item):
    return {name: state for name, state, _ in compare_program(item)}


def test_the_digest_of_the_table_is_that_of_its_file():
    table = Path(rows.__file__).with_name("tolerances.csv")
    assert program_digests()[TABLE] == file_sha256(table)
    assert pom.provenance([], {})["program"] == program_digests()


def test_the_same_installation_agrees():
    assert set(states(statement()).values()) == {"same"}


@pytest.mark.parametrize("version", [OWN, "0.0.1"])
def test_an_edited_table_is_found_by_any_version(version):
    found = states(statement(changed=[TABLE, "pom"], version=version))
    assert found[TABLE] == "changed"
    # an edited module only by the same version: another one has other files
    assert found["pom"] == ("unknown" if version == "0.0.1" else "changed")
    assert found["flightmech"] == "same"


def test_a_manifest_without_the_program_is_not_called_the_same():
    assert states({"predicate": {"runDetails": {"builder": {"version": {}}}}}) == {
        PROGRAM: "unknown"
    }
