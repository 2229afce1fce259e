"""``aeromatch db import-aircraft``: database and aircraft file from JSBSim and DAVE-ML files."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import aerodb
import flightmech
from aerodb.cli.group import db
from flightmech.errors import ParseError
from flightmech.units import POUND, SLUG

MODELS = (
    Path(__file__).parents[3] / ".." / "shared" / "data" / "flight" / "nesc_checkcases" / "models"
)
samples = pytest.mark.skipif(not MODELS.exists(), reason="needs the DAVE-ML samples of ../shared")

JSBSIM = """<fdm_config name="trainer" version="2.0"><metrics><wingarea unit="FT2">180</wingarea>
<wingspan unit="FT">30</wingspan>
<chord unit="FT">6</chord><location name="AERORP" unit="IN"><x>100</x><y>0</y><z>10</z></location>
</metrics>
<mass_balance negated_crossproduct_inertia="true"><ixx unit="SLUG*FT2">1000</ixx>
<iyy unit="SLUG*FT2">2000</iyy>
<izz unit="SLUG*FT2">2500</izz><ixz unit="SLUG*FT2">50</ixz><emptywt unit="LBS">3000</emptywt>
<location name="CG" unit="IN"><x>98</x><y>0</y><z>8</z></location>
<pointmass name="pilot"><weight unit="LBS">200</weight><location unit="IN"><x>50</x><y>10</y>
<z>20</z></location></pointmass></mass_balance>
<propulsion><tank type="FUEL"><location unit="IN"><x>110</x><y>-5</y><z>0</z></location>
<radius unit="IN">20</radius>
<capacity unit="LBS">500</capacity><contents unit="LBS">300</contents></tank></propulsion>
<ground_reactions/><aerodynamics><axis name="DRAG"/><axis name="SIDE"/><axis name="LIFT">
<function name="aero/force/lift"><product><property>aero/qbar-psf</property>
<property>metrics/Sw-sqft</property><sin><property>aero/alpha-rad</property></sin></product>
</function></axis></aerodynamics></fdm_config>"""


def run(*arguments):
    return CliRunner().invoke(db, ["import-aircraft", *map(str, arguments)], catch_exceptions=False)


@pytest.fixture
def trainer(tmp_path):
    path = tmp_path / "trainer.xml"
    path.write_text(JSBSIM)
    return path


def test_a_jsbsim_aircraft_becomes_database_and_aircraft_file(trainer, tmp_path):
    done = run(
        trainer,
        "-o",
        tmp_path / "out.nc",
        "--sample",
        "1e-3",
        "--grid",
        "alpha=-10 20 deg",
        "--x-ref-mac",
        "0.3",
    )
    assert done.exit_code == 0, done.output
    assert "nodes: largest difference seen" in done.stdout
    assert "engines, landing gear and limits of the controls are not read" in done.stdout
    craft = flightmech.read_aircraft(tmp_path / "out.toml")
    assert (craft.name, craft.mass, craft.x_ref_mac) == (
        "trainer",
        pytest.approx(3500.0 * POUND, rel=1e-12),
        0.3,
    )
    assert float(
        aerodb.evaluate(aerodb.open(tmp_path / "out.nc"), "CL", alpha=0.1)
    ) == pytest.approx(np.sin(0.1), abs=1e-3)


def test_mass_cg_and_inertia_are_those_with_which_jsbsim_starts(trainer, tmp_path):
    jsbsim = pytest.importorskip("jsbsim", reason="jsbsim is not installed: pip install jsbsim")
    folder = tmp_path / "aircraft" / "trainer"
    folder.mkdir(parents=True)
    (folder / "trainer.xml").write_text(JSBSIM)
    program = jsbsim.FGFDMExec(str(tmp_path))
    program.set_debug_level(0)
    program.load_model("trainer")
    program.run_ic()
    craft, slug_ft2 = aerodb.exchange.import_jsbsim_aircraft(trainer), SLUG * 0.3048**2
    assert craft.mass == pytest.approx(program["inertia/weight-lbs"] * POUND, rel=1e-12)
    for name in ("Ixx", "Iyy", "Izz"):
        assert getattr(craft, name) == pytest.approx(
            program[f"inertia/{name.lower()}-slugs_ft2"] * slug_ft2, rel=1e-7
        )  # its pounds per slug
    assert craft.Ixz == pytest.approx(-program["inertia/ixz-slugs_ft2"] * slug_ft2, rel=1e-7)
    place = np.array(craft.cg) + craft.reference
    assert place == pytest.approx(
        np.array([-1, 1, -1]) * [program[f"inertia/cg-{axis}-in"] * 0.0254 for axis in "xyz"],
        abs=1e-12,
    )


@pytest.mark.nightly
@samples
def test_a_daveml_package_becomes_database_and_aircraft_file(tmp_path):
    files = (
        MODELS / "F16_aero.dml",
        "--inertia",
        MODELS / "F16_inertia.dml",
        "--propulsion",
        MODELS / "F16_prop.dml",
    )
    options = (
        "--at",
        "CG_PCT_MAC=25",
        "--x-ref-mac",
        "0.35",
        "--name",
        "F-16",
        "-o",
        tmp_path / "f16.nc",
    )
    done = run(*files, *options, "--json")
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["aircraft"] == str(tmp_path / "f16.toml")
    craft = flightmech.read_aircraft(tmp_path / "f16.toml")
    assert (craft.name, len(craft.engines), craft.cg[0]) == (
        "F-16",
        1,
        pytest.approx(0.1 * craft.cbar),
    )
    assert len(flightmech.compile(craft, aerodb.open(tmp_path / "f16.nc")).terms) == 24
    before = (tmp_path / "f16.nc").read_bytes()
    again = run(*files, *options)
    assert again.exit_code == 2
    assert "already there; give another name, or --force to overwrite" in again.stderr
    assert (tmp_path / "f16.nc").read_bytes() == before
    assert run(*files, *options, "--force").exit_code == 0


@samples
def test_a_sampled_coefficient_prints_how_well(tmp_path):
    done = CliRunner().invoke(
        db,
        [
            "import",
            str(MODELS / "twostage_aero.dml"),
            "--sample",
            "0.02",
            "-o",
            str(tmp_path / "x.nc"),
        ],
    )
    assert done.exit_code == 0, done.output
    assert "CD/basic: totalCoefficientOfDrag sampled on " in done.stdout
    assert "CD differs from the file by at most 0.0" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--inertia", "trainer.xml"], "--inertia belongs to daveml; leave it out for jsbsim"),
        (["--grid", "alpha=-10 20 deg"], "give --sample, the largest difference allowed, with it"),
        (
            ["--sample", "0.1", "--grid", "alpha=-10 0 20 deg"],
            "for jsbsim give the two ends of a range",
        ),
        (
            ["-o", "out.toml"],
            "is the aircraft file's name; give that of the database, such as out.nc",
        ),
    ],
)
def test_options_that_do_not_fit_are_refused(trainer, tmp_path, arguments, text, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = run("trainer.xml", "-o", "out.nc", *arguments)
    assert done.exit_code == 2
    assert text in done.stderr
    assert sorted(file.name for file in tmp_path.iterdir()) == ["trainer.xml"]


@samples
def test_a_daveml_file_without_mass_properties_is_no_aircraft(tmp_path):
    done = run(MODELS / "F16_aero.dml", "-o", tmp_path / "x.nc")
    assert done.exit_code == 2
    assert "--inertia is needed: a DAVE-ML file of aerodynamics holds no mass" in done.stderr


def test_what_of_the_mass_cannot_be_read_is_refused(trainer):
    trainer.write_text(JSBSIM.replace("<weight unit", '<form shape="cone"/><weight unit'))
    with pytest.raises(ParseError, match="shape 'cone' of a point mass; expected one of ball, sph"):
        aerodb.exchange.import_jsbsim_aircraft(trainer)
    trainer.write_text(JSBSIM.replace("<propulsion>", "<buoyant_forces/><propulsion>"))
    with pytest.raises(ParseError, match="an aircraft without gas cells"):
        aerodb.exchange.import_jsbsim_aircraft(trainer)
