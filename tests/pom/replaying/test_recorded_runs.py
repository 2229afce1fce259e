"""Recordings of a device judged like a model, and runs compared with those of an earlier report."""

import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import pom
from aeromatch.cli.command import main
from flightmech.errors import OutOfRange, SchemaError
from pom.archive.masters import read_masters
from pom.cli.actions.batch_files import _parse_starts
from pom.replaying.recorded_runs import RecordedRun, read_recording, resample_run
from pom.replaying.recordings.device_inputs import compare_inputs
from pom.replaying.recordings.recording_sizes import size_remarks

DEGREE = np.pi / 180.0
# headings of a host recorder: name, factor from SI
COLUMNS = {
    "theta": ("THETA [deg]", 1.0 / DEGREE),
    "q": ("Q [deg/s]", 1.0 / DEGREE),
    "nz": ("NZ [g]", 1.0),
    "delta_e": ("ELEV [deg]", 1.0 / DEGREE),
    "engine1.thrust": ("THRUST [kN]", 1e-3),
}


@pytest.fixture
def aeromatch(tmp_path, monkeypatch, capsys):
    def call(*words):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["aeromatch", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        output = capsys.readouterr()
        return SimpleNamespace(returncode=ended.value.code, stdout=output.out, stderr=output.err)

    return call


@pytest.fixture
def case(write_case, lag_states, tmp_path):
    path = write_case(more="trim = false")
    lag_states.to_netcdf(tmp_path / "record.nc", engine="h5netcdf")
    return path


@pytest.fixture
def record(lag_states, tmp_path):
    """Write the flight of the case as the recording of a device, with its name map: from 1 s, at
    40 Hz, on its own clock.
    """

    def write(change=None, without=(), gap=None, file="host.csv", step=0.025):
        clock = np.arange(0.0, 8.01, step)
        columns = {"t [s]": clock}
        for name, (head, factor) in COLUMNS.items():
            if name in without:
                continue
            values = np.interp(clock + 1.0, lag_states["time"], lag_states[name])
            if change and name in change:
                values = change[name](clock, values)
            columns[head] = values * factor
        table = np.column_stack(list(columns.values()))
        if gap:
            table = table[(clock < gap[0]) | (clock > gap[1])]
        text = ",".join(columns) + "\n"
        text += "\n".join(",".join(f"{x:.9g}" for x in row) for row in table)
        path = tmp_path / file
        path.parent.mkdir(exist_ok=True)
        path.write_text(text + "\n")
        entries = []
        for name, (head, _) in COLUMNS.items():
            if name not in without:
                entries.append(f'"{name}" = "{head.split()[0]}"')
        (tmp_path / "host.toml").write_text("[host]\n" + "\n".join(entries) + "\n")
        return path

    return write


def words(case, *more):
    return ("pom", "run", case, "--model", "device=host.csv", "--names", "device=host.toml", *more)


START = ("--start", "device=0")


def test_a_recording_is_judged_and_the_shift_of_its_clock_stated(case, record, tmp_path):
    read = pom.read_case(case)
    run = read_recording(record(), read, tmp_path / "host.toml", start=0.0)
    assert "40 Hz, its clock +1 s is that of the flight record" in run.source
    with pytest.raises(OutOfRange, match=r"cover 0 \.\.\. 8 s on the clock of the flight record"):
        read_recording(record(), read, tmp_path / "host.toml")
    (tmp_path / "few.toml").write_text('[host]\ndelta_e = "ELEV"\n')
    with pytest.raises(SchemaError, match="none of the judged channels"):
        read_recording(record(), read, tmp_path / "few.toml", start=0.0)


def test_gaps_and_turns_are_not_bridged():
    clock = np.array([0.0, 0.1, 0.2, 1.0, 1.1])
    heading = np.array([3.1, 3.14, -3.1, 3.0, 3.1])
    run = RecordedRun({"psi": (clock, heading)}, "", "")
    found = resample_run(run, np.array([0.15, 0.2, 0.6, 1.0, 1.5]))["psi"]
    # half way between 3.14 and -3.1 + 2 pi
    assert found[0] == pytest.approx(0.5 * (3.14 - 3.1 + 2.0 * np.pi))
    assert np.isnan(found[[2, 4]]).all()
    assert np.isfinite(found[[1, 3]]).all()


@pytest.mark.slow
def test_a_device_alone_passes_and_is_in_the_manifest(aeromatch, case, record, tmp_path):
    record()
    done = aeromatch(*words(case, *START, "-o", "out", "--no-pdf"))
    assert done.returncode == 0, done.stderr
    assert "device       pass with departures  0.0" in done.stdout
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    listed = manifest["predicate"]["buildDefinition"]["resolvedDependencies"]
    assert {"case.toml", "host.csv", "host.toml", "record.nc"} == {x["name"] for x in listed}
    assert {item.state for item in pom.verify(tmp_path / "out")} == {"same"}


@pytest.mark.nightly
@pytest.mark.parametrize("is_copy", [True, False])
def test_a_copy_of_the_record_is_no_recording_of_a_device(
    aeromatch, case, record, lag_states, tmp_path, is_copy
):
    """A device has its own noise; the recording of the flight has that of the record."""
    generator = np.random.default_rng(3)
    noisy = {}
    for name, size in {"theta": 2e-4, "q": 2e-4, "nz": 2e-3}.items():
        noise = size * generator.standard_normal(lag_states.sizes["time"])
        noisy[name] = lag_states[name] + noise
    lag_states.assign(noisy).to_netcdf(tmp_path / "record.nc", engine="h5netcdf")

    def copy(name):
        return lambda clock, values: np.interp(clock + 1.0, lag_states["time"], noisy[name])

    record({name: copy(name) for name in noisy} if is_copy else None, step=0.02)
    done = aeromatch(*words(case, *START))
    assert done.returncode == (1 if is_copy else 0)
    assert ("the answer holds the noise of the record" in done.stdout) == is_copy


def test_a_wrong_answer_fails(aeromatch, case, record):
    record({name: lambda clock, values: 4.0 * values for name in ("theta", "q")})
    done = aeromatch(*words(case, *START))
    assert done.returncode == 1
    assert "FAIL" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    ("made", "text"),
    [
        (
            {"change": {"delta_e": lambda clock, values: np.interp(clock - 0.2, clock, values)}},
            "the inputs of the device are not those of the flight: delta_e",
        ),
        ({"without": ("delta_e",)}, "the recording has no delta_e, so nothing shows"),
    ],
)
def test_other_inputs_are_a_departure(aeromatch, case, record, made, text):
    record(**made)
    done = aeromatch(*words(case, *START))
    assert "pass with departures" in done.stdout
    assert text in done.stdout


@pytest.mark.parametrize(("gain", "departs"), [(1.05, False), (1.3, True), (0.8, True)])
def test_the_size_of_a_short_input_is_compared(gain, departs):
    """A doublet of 2 s in 20 s: at 1.3 times its size the rms is 6 % of the movement."""
    time = np.arange(0.0, 20.0, 0.02)
    elevator = 0.05 * (np.where((time > 5) & (time < 6), 1.0, 0.0) - ((time > 6) & (time < 7)))
    job = SimpleNamespace(needed_inputs=["delta_e"], inputs={"delta_e": elevator}, time=time)
    remarks = list(compare_inputs(job, {"applied.delta_e": gain * elevator}))
    assert (remarks[0].kind == "departure") == departs
    assert f"{gain:.2f} times its size" in remarks[0].text


def test_an_input_of_opposite_sign_is_named():
    """Half a period later, a doublet looks like one of the other sign at half its size."""
    time = np.arange(0.0, 20.0, 0.02)
    elevator = 0.05 * (np.where((time > 5) & (time < 6), 1.0, 0.0) - ((time > 6) & (time < 7)))
    job = SimpleNamespace(needed_inputs=["delta_e"], inputs={"delta_e": elevator}, time=time)
    first, *_ = compare_inputs(job, {"applied.delta_e": -elevator})
    assert "-1.00 times its size, +0.00 s, of opposite sign" in first.text


@pytest.mark.parametrize(
    ("name", "change", "text"),
    [
        ("theta", lambda x: x / DEGREE, "57.3 times that of the flight, as deg read as rad"),
        ("theta", lambda x: x * DEGREE, "0.0175 times that of the flight, as rad read as deg"),
        ("theta", lambda x: -x, "-1.00 times that of the flight, of opposite sign"),
        ("theta", lambda x: 0.0 * x, "holds one value for the whole case in theta"),
        (
            "theta",
            lambda x: np.where(np.arange(400) < 150, x, x[150]),
            "for a part of the case in theta (62% of the case; flight meanwhile",
        ),
        # at rest before the first input
        ("theta", lambda x: np.where(np.arange(400) < 60, x[60], x), ""),
        ("V", lambda x: 1.95 * x, "1.95 times that of the flight, as kt read as m/s"),
        ("h", lambda x: 0.3048 * x, "0.305 times that of the flight, as m read as ft"),
        ("nz", lambda x: 9.81 * x, "9.81 times that of the flight, as m/s2 read as g"),
        ("theta", lambda x: 1.3 * x + 0.01, ""),
    ],
)
def test_size_and_sign_of_a_recorded_channel_are_compared(name, change, text):
    """A row with two alternatives passes by the other one."""
    time = np.arange(0.0, 20.0, 0.05)
    flight = {
        "theta": 0.1 * np.sin(time),
        "V": 50.0 + np.sin(time),
        "h": 1500.0 + time,
        "nz": 1.0 + 0.3 * np.sin(time),
    }
    device = flight | {name: change(flight[name])}
    found = [remark.text for remark in size_remarks(flight, device)]
    assert len(found) == bool(text)
    assert text in "".join(found)


@pytest.mark.parametrize(
    ("name", "change", "text"),
    [
        ("nz", lambda x: x - 1.0, "as if the host recorded nz - 1, the increment; give it offset"),
        ("V_cas", lambda x: x + 7.7, "15 kt above the flight throughout: another initial state"),
        ("V_cas", lambda x: x + np.linspace(7.7, 0.0, x.size), "at the start, and the flight"),
        ("V_cas", lambda x: x + 2.0, ""),
        ("V_cas", lambda x: x + np.linspace(0.0, 7.7, x.size), ""),
        ("nz", lambda x: 1.1 * x, ""),
    ],
)
def test_a_displaced_channel_of_a_recording_is_named(name, change, text):
    time = np.arange(0.0, 20.0, 0.05)
    flight = {"V_cas": 50.0 + 0.5 * np.sin(time), "nz": 1.0 + 0.3 * np.sin(time)}
    device = flight | {name: change(flight[name])}
    found = [remark.text for remark in size_remarks(flight, device)]
    assert len(found) == bool(text)
    assert text in "".join(found)


def test_a_gap_is_invalid(aeromatch, case, record):
    record(gap=(3.0, 4.0))
    done = aeromatch(*words(case, *START))
    assert done.returncode == 1
    assert "INVALID" in done.stdout


@pytest.mark.nightly
def test_a_recurrent_run_is_compared_with_its_master(aeromatch, case, record, tmp_path):
    record()
    aeromatch(*words(case, *START, "-o", "master", "--no-pdf"))
    master = ("--master", "device=master")
    done = aeromatch(*words(case, *START, *master))
    assert done.returncode == 0
    assert "recurrent: within the criterion (each row within 20 %" in done.stdout
    assert "device-master pass" in done.stdout
    # 0.4 deg is within the 1.5 deg of the row, and beyond 20 % of them
    record({"theta": lambda clock, values: values + 0.4 * DEGREE})
    done = aeromatch(*words(case, *START, *master, "-o", "out", "--no-pdf"))
    assert done.returncode == 1
    assert "recurrent: beyond the criterion" in done.stdout
    assert "largest 1.33 of it in pitch_angle" in done.stdout
    assert 'name="within the recurrent criterion"' in (tmp_path / "out/results.xml").read_text()
    assert {item.state for item in pom.verify(tmp_path / "out")} == {"same"}
    done = aeromatch(*words(case, *START, *master, "--recurrent-share", "0.3"))
    assert "largest 0.89 of it in pitch_angle" in done.stdout
    moved = case.read_text().replace("[1.0, 9.0]", "[1.0, 8.0]")
    case.write_text(moved)
    with pytest.raises(SchemaError, match=r"the master has 1 \.\.\. 9 s"):
        read_masters(tmp_path / "master", "device", [pom.read_case(case)])


@pytest.mark.slow
def test_a_master_of_another_flight_is_a_departure(aeromatch, case, record, lag_states, tmp_path):
    """The files of both records have one name; a model cannot be that near to two flights."""
    record()
    aeromatch(*words(case, *START, "-o", "master", "--no-pdf"))
    other = lag_states.assign(theta=lag_states["theta"] + np.radians(1.0))
    other.to_netcdf(tmp_path / "later.nc", engine="h5netcdf")
    case.write_text(case.read_text().replace('"record.nc"', '"later.nc"'))
    done = aeromatch(*words(case, *START, "--master", "device=master"))
    assert "the master is of another flight" in done.stdout


def test_options_of_recordings_are_checked(aeromatch, case, record, tmp_path):
    record()
    done = aeromatch(*words(case, "--start", "devise=0"))
    assert done.returncode == 2
    assert "near it: device" in done.stderr
    assert aeromatch(*words(case, "--start", "device=now")).returncode == 2
    with pytest.raises(SchemaError, match="'device=inf': write NAME=SECONDS, such as device=0"):
        _parse_starts(["device=inf"], {"device": record})
    done = aeromatch(*words(case, "--master", "other=host.csv"))
    assert "unknown model 'other'" in done.stderr
    done = aeromatch(*words(case, "--recurrent-share", "0.2"))
    assert "--recurrent-share needs --master" in done.stderr


def test_a_folder_holds_a_recording_for_each_case(aeromatch, case, record):
    record(file="runs/a_case.csv")
    command = ("pom", "run", case, "--model", "device=runs", "--names", "device=host.toml", *START)
    assert aeromatch(*command).returncode == 0
    record(file="runs/a_case.txt")
    done = aeromatch(*command)
    assert done.returncode == 2
    assert "a_case.csv, a_case.txt" in done.stderr
