"""Databases written as DAVE-ML: what stands in the file, and that it comes back the same."""

import re
from dataclasses import dataclass, field

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import aerodb
from aerodb.exchange.daveml.document.reading import read
from aerodb.exchange.daveml.export_checks import BEYOND
from aerodb.exchange.daveml.vocabulary import (
    pack_attributes,
    source_codes,
    source_runs,
    unpack_attributes,
)
from aerodb.exchange.xml_reader import read_xml
from flightmech import terms
from flightmech.errors import AeromatchWarning, SchemaError
from flightmech.names import quantity_attributes

# Content models of the elements we write, from DAVEfunc.dtd 2.0.2 of 12 July 2011, as regular
# expressions over the children
CONTENT = {
    "DAVEfunc": "fileHeader (variableDef )+(breakpointDef )*(griddedTableDef )*(ungriddedTableDef "
    ")*(function )*(checkData )?",
    "fileHeader": "(author )+(creationDate |fileCreationDate )(fileVersion )?(description "
    ")?(reference )*(modificationRecord )*"
    "(provenance )*",
    "variableDef": "(description )?(provenance |provenanceRef )?(calculation )?(isInput "
    "|isControl |isDisturbance )?(isState )?"
    "(isStateDeriv )?(isOutput )?(isStdAIAA )?(uncertainty )?",
    "breakpointDef": "(description )?bpVals ",
    "griddedTableDef": "(description )?(provenance |provenanceRef )?breakpointRefs (uncertainty "
    ")?dataTable ",
    "function": "(description )?(provenance |provenanceRef )?((independentVarPts "
    ")+dependentVarPts |"
    "(independentVarRef )+dependentVarRef functionDefn )",
    "functionDefn": "(griddedTableRef |griddedTableDef )",
    "modificationRecord": "(author )+(description )?(extraDocRef )*",
    "provenance": "(author )+(creationDate )(documentRef )*(modificationRef )*(description )?",
    "uncertainty": "(normalPDF |uniformPDF )",
    "normalPDF": "bounds (correlatesWith )*(correlation )*",
    "checkData": "(provenance |provenanceRef )?(staticShot )+",
    "staticShot": "(description )?(provenance |provenanceRef )?(checkInputs )?(internalValues "
    ")?checkOutputs ",
    "signal": "(signalName signalUnits |varID )signalValue (tol )?",
    "calculation": "math ",
}
REQUIRED = {
    "variableDef": ("name", "varID", "units"), "breakpointDef": ("bpID",),
    "griddedTableDef": ("gtID",), "function": ("name",),
    "author": ("name", "org"), "creationDate": ("date",),
    "reference": ("refID", "author", "title", "date"),
    "modificationRecord": ("modID", "date"), "independentVarRef": ("varID",),
    "dependentVarRef": ("varID",), "staticShot": ("name",),
    "uncertainty": ("effect",), "normalPDF": ("numSigmas",), "griddedTableRef": ("gtID",),
    "bpRef": ("bpID",),
}  # fmt: skip
IDENTIFIERS = ("varID", "bpID", "gtID", "refID", "modID", "provID")
DEFINITIONS = {
    "variableDef",
    "breakpointDef",
    "griddedTableDef",
    "reference",
    "modificationRecord",
    "provenance",
}


@dataclass(frozen=True)
class ExportedCraft:
    S: float = 16.9
    cbar: float = 1.667
    b: float = 10.31
    name: str = "test"
    limits: dict = field(default_factory=lambda: {"delta_e": (-0.35, 0.3)})


def factor(values, **axes):
    array = xr.DataArray(np.asarray(values, float), axes, tuple(axes))
    for name in axes:
        array[name].attrs.update(quantity_attributes(name))
    return array


@pytest.fixture
def rich(root):
    """A database with a term of every kind."""
    random = np.random.default_rng(4)
    alpha, mach = np.radians([-8.0, 0.0, 8.0, 16.0]), np.array([0.2, 0.4])
    table = random.normal(size=(2, 4)) / 3.0
    sources = terms.make_term(
        table,
        {"mach": mach, "alpha": alpha},
        stderr=abs(table) / 7.0,
        source="datcom",
        references="a <b> & c.out, 12",
    )
    sources["source"].values[1, 2:] = (1, 2)
    leaves = {
        "CL/basic": sources,
        "CL/qhat": terms.make_term(table / 9.0, {"mach": mach, "alpha": alpha}, ["qhat"],
            outside="linear", comment="two\nlines: of\n\n text"),
        "CL/gear": terms.make_term(0.1, regressors=["gear"]),
        "CL/ground": terms.make_term(table, {"mach": mach, "alpha": alpha},
            K1=factor([1.0, 0.5, 0.0], h_agl=[0.0, 5.0, 20.0])),
        "CL/square": terms.make_term(0.3, regressors=["beta", "alpha"], stderr=0.07,
            source="judgement"),
        "CD/flap": terms.make_term(
            [0.0, 1.0 / 3.0], {"delta_f": [0.0, 0.7]}, ["alpha", "alpha"],
            K1=factor([0.1, 0.7], mach=[0.1, 0.9]),
            K2=factor([[1.0, 2.0], [3.0, 5.0]], gear=[0.0, 1.0], speedbrake=[0.0, 1.0]),
        ),
        "CD/speedbrake": terms.make_term(0.04, K1=factor([0.0, 1.0], speedbrake=[0.0, 1.0]),
            stderr=0.01),
        "CD/held": terms.make_term(0.04, K1=factor([0.0, 1.0], speedbrake=[0.0, 1.0])),
        "Cl/phat": terms.make_term(-0.4, regressors=["phat"]),
        "Cl/rhat": terms.make_term([0.1, 0.2], {"mach": mach}, ["rhat"]),
        "Cm/alphadothat": terms.make_term(-7.0, regressors=["alphadothat"]),
        "Cm/single": terms.make_term([[0.3, 0.4]], {"delta_e": [0.1], "mach": mach},
            outside="linear"),
        "Cn/betadothat": terms.make_term(0.02, regressors=["betadothat"]),
        "Cn/load": terms.make_term([0.1, -0.1], {"h": [0.0, 10000.0]}, ["dnz"]),
        "Ch_e/alpha": terms.make_term(-0.2, regressors=["alpha"]),
        "CL/jet": terms.make_term([1e-6, 2e-6], {"engine1.throttle": [0.0, 1.0]},
            ["engine2.thrust"]),
    }  # fmt: skip
    root |= {
        "references": "First, 1993; Second",
        "history": 'built 2024-05-06\nedited: <x> & "y"',
        "comment": "é ∂\n| a line",
    }
    return aerodb.make_database(leaves, **root, edits=3)


def elements(element):
    yield element
    for child in element.children:
        yield from elements(child)


def states(count=3000, seed=3):
    random = np.random.default_rng(seed)
    return {
        "V": random.uniform(20, 200, count), "alpha": random.uniform(-0.5, 0.6, count),
        "beta": random.uniform(-0.4, 0.4, count),
        "mach": random.uniform(0.0, 1.2, count), "p": random.uniform(-2, 2, count),
        "q": random.uniform(-1, 1, count),
        "r": random.uniform(-1, 1, count), "alpha_dot": random.uniform(-1, 1, count),
        "beta_dot": random.uniform(-1, 1, count),
        "gear": random.uniform(0, 1, count), "speedbrake": random.uniform(-0.2, 1.2, count),
        "delta_f": random.uniform(-0.1, 0.9, count),
        "delta_e": random.uniform(-0.3, 0.3, count), "h_agl": random.uniform(-1, 30, count),
        "h": random.uniform(-500, 12000, count),
        "dnz": random.uniform(-1, 1, count), "engine1.throttle": random.uniform(0, 1, count),
        "engine2.thrust": random.uniform(0, 1e4, count),
    }  # fmt: skip


@pytest.mark.slow
def test_a_database_comes_back_term_by_term(rich, tmp_path):
    aerodb.exchange.export_daveml(rich, tmp_path / "db.dml")
    back = aerodb.exchange.import_daveml(tmp_path / "db.dml")
    mine, found = aerodb.terms(rich), aerodb.terms(back)
    assert list(found) == list(mine)
    assert set(back.children) == {"CL", "CD", "Cl", "Cm", "Cn", "Ch_e"}
    for name, leaf in mine.items():
        xr.testing.assert_identical(found[name], leaf)
    assert back.attrs.pop("history").startswith(
        f"{rich.attrs['history']}\nimport_daveml: db.dml, version aeromatch "
    )
    assert isinstance(back.attrs["edits"], int)
    assert dict(back.attrs) == {key: item for key, item in rich.attrs.items() if key != "history"}


@pytest.mark.slow
def test_the_file_gives_the_coefficients_of_the_database(rich, tmp_path):
    aerodb.exchange.export_daveml(rich, tmp_path / "db.dml")
    model, state = read(tmp_path / "db.dml"), states()
    S, cbar, b = (float(rich.attrs[name]) for name in ("S", "cbar", "b"))
    V = state["V"]
    reduced = {
        "phat": state["p"] * b / 2 / V,
        "qhat": state["q"] * cbar / 2 / V,
        "rhat": state["r"] * b / 2 / V,
    }
    reduced |= {
        "alphadothat": state["alpha_dot"] * cbar / 2 / V,
        "betadothat": state["beta_dot"] * b / 2 / V,
    }
    given = model.evaluate(state)
    for coefficient in ("CL", "CD", "CY", "Cl", "Cm", "Cn"):
        expected = aerodb.evaluate(rich, coefficient, outside="clamp", **state, **reduced)
        assert given[coefficient] == pytest.approx(
            np.broadcast_to(expected, V.shape), abs=1e-13
        )  # of sums of size 1 to 20
    assert given["S"][0] == S
    assert model.variables["CL"].name == "liftCoefficient"
    assert model.variables["p"].name == "bodyAngularRate_Roll"
    assert model.variables["CL"].axis_system == "stability axes"
    assert model.variables["CY"].initial == 0.0  # no term: the total is there all the same


def test_the_file_follows_the_dtd(rich, tmp_path):
    aerodb.exchange.export_daveml(rich, tmp_path / "db.dml")
    root, seen, used = read_xml(tmp_path / "db.dml", doctype=True), set(), set()
    for element in elements(root):
        if element.tag in CONTENT:
            assert re.fullmatch(
                CONTENT[element.tag], "".join(f"{child.tag} " for child in element.children)
            ), element.tag
        assert set(REQUIRED.get(element.tag, ())) <= set(element.attributes), element.tag
        for key in set(IDENTIFIERS) & set(element.attributes):
            if element.tag in DEFINITIONS:
                assert element.attributes[key] not in seen, "identifiers are unique in a file"
                seen.add(element.attributes[key])
                assert re.fullmatch(r"[A-Za-z_][\w.-]*", element.attributes[key])
            else:
                used.add(element.attributes[key])
    assert used <= seen
    assert (
        (tmp_path / "db.dml")
        .read_text(encoding="utf-8")
        .startswith('<?xml version="1.0" standalone="no"?>\n<!DOCTYPE DAVEfunc PUBLIC')
    )


def test_equal_tables_and_breakpoints_are_written_once(rich, tmp_path):
    aerodb.exchange.export_daveml(rich, tmp_path / "db.dml")
    root = read_xml(tmp_path / "db.dml", doctype=True)
    tables = {e.attributes["name"]: e for e in root.all("griddedTableDef")}
    assert (
        "CL/ground value" in tables
    )  # its values are those of CL/basic, whose standard errors it does not have
    assert "CD/held K1" not in tables  # the same as CD/speedbrake K1
    assert (
        sum(e.attributes["name"] == "mach" for e in root.all("breakpointDef")) == 2
    )  # 0.2, 0.4 and 0.1, 0.9


def test_standard_errors_and_rules_beyond_the_tables_are_attributes(rich, tmp_path):
    aerodb.exchange.export_daveml(rich, tmp_path / "db.dml")
    model = read(tmp_path / "db.dml")
    spread = model.functions["CL_basic__value"].uncertainty
    assert (spread.effect, spread.sigmas) == ("additive", 1.0)
    assert spread.bounds[0] == pytest.approx(
        aerodb.terms(rich)["CL/basic"]["stderr"].values.ravel(), rel=0.0
    )
    assert model.variables["CL_square__value"].uncertainty.bounds[0].tolist() == [0.07]
    assert model.functions["CL_qhat__value"].uncertainty is None
    rules = {
        name: {axis.extrapolate for axis in function.axes}
        for name, function in model.functions.items()
    }
    assert rules["CL_basic__value"] == {"neither"}
    assert rules["CL_qhat__value"] == {"both"}
    assert [m.description for m in model.header.modifications] == [
        "built 2024-05-06",
        'edited: <x> & "y"',
    ]
    assert (model.header.modifications[0].modID, model.header.modifications[0].date) == (
        "A",
        "2024-05-06",
    )
    assert [r.title for r in model.header.references] == ["First, 1993", "Second"]


def test_check_cases_are_spread_over_the_tables_and_beyond_and_always_the_same(rich, tmp_path):
    aerodb.exchange.export_daveml(rich, tmp_path / "db.dml", shots=24)
    model = read(tmp_path / "db.dml")
    assert len(model.shots) == 24
    alpha = np.array(
        [next(s.value for s in shot.inputs if s.key == "angleOfAttack") for shot in model.shots]
    )
    low, high = np.radians((-8.0, 16.0))
    margin = BEYOND * (high - low)
    assert ((alpha[::2] >= low) & (alpha[::2] <= high)).all()
    assert ((alpha >= low - margin) & (alpha <= high + margin)).all()
    assert np.ptp(alpha[::2]) > 0.8 * (high - low)
    assert ((alpha < low) | (alpha > high)).any()
    table = model.check()
    assert set(table["kind"]) == {"internal", "output"}
    outputs = table[table["kind"] == "output"]
    assert (outputs["tolerance"] <= 1e-9 * np.maximum(abs(outputs["expected"]), 20.0)).all()
    text = (tmp_path / "db.dml").read_bytes()
    aerodb.exchange.export_daveml(rich, tmp_path / "again.dml", shots=24)
    assert (tmp_path / "again.dml").read_bytes() == text


def test_a_wrong_digit_in_a_table_is_found_by_the_check_cases(rich, tmp_path):
    path = tmp_path / "db.dml"
    aerodb.exchange.export_daveml(rich, path)
    node = repr(float(aerodb.terms(rich)["CL/basic"]["value"].values[0, 1]))
    text = path.read_text(encoding="utf-8")
    assert node in text
    path.write_text(
        text.replace(node, node[:6] + ("1" if node[6] != "1" else "2") + node[7:]), encoding="utf-8"
    )
    with pytest.raises(SchemaError, match=r"check cases of .* that fail"):
        read(path)


@pytest.mark.nightly
def test_check_cases_of_the_database_travel_with_their_own_numbers(rich, tmp_path):
    state = {name: ("case", column) for name, column in states(3).items()}
    V, b, cbar = state["V"][1], rich.attrs["b"], rich.attrs["cbar"]
    for name, rate, length in (
        ("phat", "p", b),
        ("qhat", "q", cbar),
        ("rhat", "r", b),
        ("alphadothat", "alpha_dot", cbar),
        ("betadothat", "beta_dot", b),
    ):
        state[name] = "case", state[rate][1] * length / (2.0 * V)
    expected = aerodb.evaluate(
        rich, "CL", outside="clamp", **{name: column for name, (_, column) in state.items()}
    )
    measured = {
        "CL": ("case", expected + [0.004, 0.004, 0.006]),
        "CL_tolerance": ("case", [0.005] * 3),
    }
    cases = xr.Dataset({**state, **measured}, {"case": [1, 2, 3]}, {"names": "one\ntwo\nmissed"})
    db = xr.DataTree.from_dict({**rich.to_dict(), "/checks": cases})
    with pytest.warns(AeromatchWarning, match="does not meet their expected values: missed$"):
        aerodb.exchange.export_daveml(db, tmp_path / "db.dml")
    stored = {
        shot.name: shot
        for shot in read(tmp_path / "db.dml").shots
        if shot.name.startswith("checks: ")
    }
    assert list(stored) == ["checks: one", "checks: two"]  # the third is not met by the database
    lift = next(
        signal for signal in stored["checks: one"].outputs if signal.key == "liftCoefficient"
    )
    assert lift.value == pytest.approx(float(expected[0]) + 0.004, rel=1e-15)
    assert lift.tolerance == 0.005
    aerodb.save(aerodb.exchange.import_daveml(tmp_path / "db.dml"), tmp_path / "db.nc")
    kept = aerodb.open(tmp_path / "db.nc")["checks"].to_dataset()
    assert kept.attrs["names"] == "one\ntwo"
    assert kept["CL_tolerance"].values.tolist() == [0.005, 0.005]


@pytest.mark.slow
def test_a_check_case_with_a_missing_number_is_written_or_named(rich, tmp_path):
    """A missing coefficient is not stated in the file; a case with a missing input is named."""
    state = {name: column.copy() for name, column in states(3).items()}
    V, b, cbar = state["V"], rich.attrs["b"], rich.attrs["cbar"]
    lengths = {"p": b, "q": cbar, "r": b, "alpha_dot": cbar, "beta_dot": b}
    reduced = {"p": "phat", "q": "qhat", "r": "rhat"}
    reduced |= {"alpha_dot": "alphadothat", "beta_dot": "betadothat"}
    for rate, length in lengths.items():
        state[reduced[rate]] = state[rate] * length / (2.0 * V)
    state["CL"] = aerodb.evaluate(rich, "CL", outside="clamp", **state)
    state["CL"][1] = np.nan
    state["alpha"][2] = np.nan
    columns = {name: ("case", column) for name, column in state.items()}
    cases = xr.Dataset(columns, {"case": [1, 2, 3]}, {"names": "one\nno lift\nno angle"})
    db = xr.DataTree.from_dict({**rich.to_dict(), "/checks": cases})
    with pytest.warns(AeromatchWarning, match="an input is not a number: no angle$"):
        aerodb.exchange.export_daveml(db, tmp_path / "db.dml")
    shots = {shot.name: shot for shot in read(tmp_path / "db.dml").shots}
    stated = {}
    for name in ("checks: one", "checks: no lift"):
        stated[name] = "liftCoefficient" in [signal.key for signal in shots[name].outputs]
    assert stated == {"checks: one": True, "checks: no lift": False}
    assert "checks: no angle" not in shots
    kept = aerodb.exchange.import_daveml(tmp_path / "db.dml")["checks"]
    assert np.isfinite(kept["CL"].values).tolist() == [True, False]


def test_an_aircraft_bounds_the_check_cases_and_must_be_the_same(rich, tmp_path):
    aerodb.exchange.export_daveml(rich, tmp_path / "db.dml", ExportedCraft())
    deflections = [
        signal.value
        for shot in read(tmp_path / "db.dml").shots
        for signal in shot.inputs
        if signal.key == "elevatorDeflection"
    ]
    assert max(deflections) <= 0.3 + BEYOND * 0.65
    assert max(deflections) > 0.2
    with pytest.raises(
        SchemaError, match=r"b is 10\.31 in the database and 11 in the aircraft; they must agree"
    ):
        aerodb.exchange.export_daveml(rich, tmp_path / "other.dml", ExportedCraft(b=11.0))
    assert not (tmp_path / "other.dml").exists()


def test_what_cannot_be_written_leaves_no_file(rich, tmp_path):
    with pytest.raises(ValueError, match="shots is 0"):
        aerodb.exchange.export_daveml(rich, tmp_path / "db.dml", shots=0)
    with pytest.raises(FileNotFoundError, match="no such folder"):
        aerodb.exchange.export_daveml(rich, tmp_path / "nowhere" / "db.dml")
    broken = xr.DataTree.from_dict({**rich.to_dict(), "/CL/basic": xr.Dataset()})
    with pytest.raises(SchemaError, match="CL/basic: has no variable 'value'"):
        aerodb.exchange.export_daveml(broken, tmp_path / "db.dml")
    assert list(tmp_path.iterdir()) == []


def test_a_term_over_a_coefficient_is_refused(root, tmp_path):
    """The file would have the coefficient as an output and as an input of the same name."""
    leaves = {
        "CL/basic": terms.make_term(0.4),
        "CD/polar": terms.make_term([0.02, 0.05], {"CL": [0.0, 1.0]}),
        "Cm/drag": terms.make_term(0.1, regressors=["CD"]),
    }
    with pytest.raises(
        SchemaError,
        match=r"CD/polar: CL is an output of the file and no input(.|\n)*Cm/drag: CD is an output",
    ):
        aerodb.exchange.export_daveml(
            aerodb.store.make_database(leaves, **root), tmp_path / "polar.dml"
        )


def test_body_axes_and_contributions_with_like_names(root, tmp_path):
    root["force_axes"] = "body"
    leaves = {
        f"CX/{name}": terms.make_term([0.1, 0.2], {"alpha": [0.0, 1.0]})
        for name in ("basic", "basic__value", "basic__K1")
    }
    db = aerodb.make_database(leaves, **root)
    aerodb.exchange.export_daveml(db, tmp_path / "db.dml")
    back = aerodb.exchange.import_daveml(tmp_path / "db.dml")
    assert back.attrs["force_axes"] == "body"
    assert list(aerodb.terms(back)) == list(leaves)
    assert {"CX", "CY", "CZ", "Cl", "Cm", "Cn"} <= set(read(tmp_path / "db.dml").outputs)


def test_characters_that_xml_does_not_allow_are_replaced(root, tmp_path):
    root["title"] = 'bell \x07 & "quote" <tag> ]]>'
    aerodb.exchange.export_daveml(
        aerodb.make_database({"CL/basic": terms.make_term(0.1)}, **root), tmp_path / "db.dml"
    )
    assert (
        aerodb.exchange.import_daveml(tmp_path / "db.dml").attrs["title"]
        == 'bell ? & "quote" <tag> ]]>'
    )


@pytest.mark.nightly
@given(
    st.dictionaries(
        st.from_regex("[a-z_]{1,8}", fullmatch=True),
        st.text(st.characters(min_codepoint=32, max_codepoint=0x2FF)) | st.floats(-1e9, 1e9),
    )
)
def test_descriptions_come_back(attributes):
    assert unpack_attributes(pack_attributes(attributes)) == attributes


@pytest.mark.slow
@given(st.lists(st.integers(0, 2), min_size=1, max_size=30))
def test_sources_come_back(flags):
    array = np.array(flags, np.uint8)
    assert source_codes(source_runs(array), array.shape).tolist() == flags
    assert source_codes(source_runs(array), (len(flags) + 1,)) is None
