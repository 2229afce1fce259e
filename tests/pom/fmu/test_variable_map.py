"""Tables of names: what joins canonical names and a foreign FMU, and what is refused before
anything runs.
"""

import pytest

from flightmech.errors import SchemaError
from pom.cases.case import read_case
from pom.fmu.description import read_fmu_interface
from pom.fmu.variable_map import Link, links_of
from pom.replaying.replay_case import replay

STRANGE = {"theta": "Pitch", "delta_e": "Elev", "init.theta": "Pitch0"}
NAMES = """
[inputs]
delta_e = {variable = "Elev", sign = -1}
[outputs]
theta = {variable = "Pitch"}
[parameters]
"init.theta" = {variable = "Pitch0", unit = "deg"}
"""


@pytest.fixture
def foreign(toy):
    return toy(rename=STRANGE, units={"theta": "deg"})


@pytest.fixture
def table(tmp_path):
    def write(text):
        path = tmp_path / "names.toml"
        path.write_text(text)
        return path

    return write


def test_names_that_are_canonical_need_no_entry(foreign, table):
    links = links_of(read_fmu_interface(foreign), table(NAMES))
    assert links.inputs["delta_e"] == Link("Elev", -1.0)
    assert links.outputs["theta"].factor == pytest.approx(
        0.017453292519943295, rel=1e-15
    )  # as the FMU declares it
    assert links.outputs["q"] == Link("q")
    assert "Pitch" not in links.outputs
    assert links.parameters["init.theta"].to_fmu(0.017453292519943295) == pytest.approx(1.0)


def test_temperatures_and_scales():
    assert Link("T", 1.0, 273.15).to_canonical(15.0) == pytest.approx(288.15)
    assert Link("T", 1.0, 273.15).to_fmu(288.15) == pytest.approx(15.0)
    assert Link("flap", -0.5).to_fmu(1.0) == -2.0


def test_every_fault_of_a_table_is_reported_at_once(foreign, table):
    faults = """
[inputs]
delta_e = {variable = "Elevv"}
delta_x = "engine1.thrust_drive"
[outputs]
theta = {variable = "Pitch", unit = "rad"}
phi = {variable = "q", unit = "ft"}
h = "q"
[parameters]
"init.theta" = {variable = "Pitch"}
[fixed]
"Pitch1" = 2.0
"""
    with pytest.raises(SchemaError) as caught:
        links_of(read_fmu_interface(foreign), table(faults))
    text = str(caught.value)
    assert "inputs.delta_e: unknown input of the FMU 'Elevv'; near it: Elev" in text
    assert "inputs.delta_x: unknown quantity 'delta_x'" in text
    assert (
        "outputs.theta: the table gives 'rad' and the FMU declares 'deg'; correct the table" in text
    )
    assert "outputs.phi: unit 'ft' cannot be converted to 'rad'" in text
    assert "outputs.h: 'q' is phi already; a variable has one canonical name" in text
    assert "outputs.h: unit 'rad/s' cannot be converted to 'm'" in text
    assert "parameters.init.theta: unknown parameter of the FMU 'Pitch'; near it: Pitch0" in text
    assert "fixed: unknown input or parameter of the FMU 'Pitch1'; near it: Pitch0" in text
    assert "inputs: nothing drives the input 'Elev' of the FMU" in text


def test_a_scale_is_for_a_variable_without_a_unit(foreign, table):
    text = NAMES.replace('variable = "Elev"', 'variable = "Elev", scale = "10 deg"')
    with pytest.raises(
        SchemaError, match="a scale is for a variable without a unit; this one is in 'rad'"
    ):
        links_of(read_fmu_interface(foreign), table(text))


def test_misspelt_keys_are_reported(foreign, table):
    with pytest.raises(SchemaError, match=r"inputs\.delta_e.units: unknown key; near it: unit"):
        links_of(read_fmu_interface(foreign), table(NAMES.replace("sign = -1", 'units = "deg"')))


def test_a_table_for_a_model_that_is_not_there(write_case, toy, table, lag_states):
    case = read_case(write_case(more="trim = false"))
    with pytest.raises(SchemaError, match="other: no such model; there are toy"):
        replay(case, {"toy": toy()}, lag_states, names={"other": table(NAMES)})


def test_the_case_still_states_what_it_lacks(write_case, foreign, table, lag_states):
    case = read_case(write_case(more="trim = false"))
    text = NAMES.replace('theta = {variable = "Pitch"}', "")
    with pytest.raises(
        SchemaError,
        match=r"unknown output 'theta'.*the case needs it and the FMU does not offer it",
    ):
        replay(case, {"toy": foreign}, lag_states, names={"toy": table(text)})


@pytest.mark.parametrize(
    ("condition", "way"),
    [
        ('"device.ice.setting" = 1.0', "give the project the key ice"),
        ('"device.probe.setting" = 1.0', "no term of the database depends on it"),
        ("crossfeed = 1.0", r"needs tanks in \[fuel\]"),
    ],
)
def test_an_input_without_its_part_names_what_gives_it(condition, way, write_case, toy, lag_states):
    case = read_case(write_case(more=f"trim = false\n\n[conditions]\n{condition}"))
    with pytest.raises(SchemaError, match=f"unknown input .*{way}"):
        replay(case, {"toy": toy()}, lag_states)


def test_a_fixed_value_and_the_sign_reach_the_fmu(write_case, toy, table, lag_states):
    """The toy in degrees of pitch with an elevator the other way: the recorded one is turned back,
    the thrust stays as fixed.
    """
    case = read_case(write_case(case='show = ["theta"]', more="trim = false"))
    turned = lag_states.assign(delta_e=-lag_states["delta_e"])
    text = '[inputs]\ndelta_e = {variable = "Elev", sign = -1}\n'
    fmu = toy(rename={"delta_e": "Elev"})
    result = replay(case, {"toy": fmu}, turned, names={"toy": table(text)})
    assert abs(result.signals["theta"][1] - result.signals["theta"][0]).max() < 1e-14
    fixed = replay(
        case,
        {"toy": fmu},
        lag_states.assign(delta_e=0.0 * lag_states["delta_e"]),
        names={"toy": table("[fixed]\nElev = 0.1\n")},
    )
    assert fixed.signals["nz"][1].values == pytest.approx(1.0 - 4.0 * 0.1, abs=1e-15)


def test_a_case_file_may_name_the_table_and_the_call_goes_before_it(
    write_case, toy, table, lag_states, tmp_path
):
    turned = table('[inputs]\ndelta_e = {variable = "Elev", sign = -1}\n')
    (tmp_path / "plain.toml").write_text('[inputs]\ndelta_e = "Elev"\n')
    case = read_case(
        write_case(
            case='show = ["theta"]',
            more='trim = false\n[models]\ntoy = "names.toml"\nother = "plain.toml"',
        )
    )
    assert case.files()[2:] == [str(turned), str(tmp_path / "plain.toml")]
    fmu = toy(rename={"delta_e": "Elev"})
    own = replay(case, {"toy": fmu}, lag_states)
    given = replay(case, {"toy": fmu}, lag_states, names={"toy": tmp_path / "plain.toml"})
    assert own.signals["theta"][1].values == pytest.approx(
        -given.signals["theta"][1].values, abs=1e-15
    )
    with pytest.raises(SchemaError, match=r"models\.toy: no file .*gone.toml"):
        read_case(write_case(more='trim = false\n[models]\ntoy = "gone.toml"'))
