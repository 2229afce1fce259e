"""Packages of others: structure, signatures, foreign code in FMUs and in JSBSim files."""

import json
import os
import shutil
import zipfile
from contextlib import nullcontext
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import write_calls
import xarray as xr
from click.testing import CliRunner
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ec import SECP256R1, generate_private_key

from aerodb.exchange.jsbsim.written_elements import keep_written_elements
from aeromatch.cli.delivery import package
from aeromatch.delivery import flown_checks, package_opening
from aeromatch.delivery.contents import manifest_text
from aeromatch.delivery.flown_checks import OUTPUTS
from aeromatch.delivery.fmu_flight import fly_cases_by_fmu, foreign_library
from aeromatch.delivery.foreign_flight import fly_in_child
from aeromatch.delivery.package_documents import readme_text
from aeromatch.delivery.package_files import (
    PackageCheck,
    check_hashes,
    check_structure,
)
from aeromatch.delivery.package_opening import unpack_package
from aeromatch.delivery.places import CONTENT
from aeromatch.delivery.signing import (
    PackageSignature,
    check_signature,
    make_key,
    read_private_key,
    read_public_key,
    signature_text,
)
from aeromatch.delivery.verification import (
    check_package_signature,
    describe_verdict,
    verify_package,
)
from flightmech.errors import SchemaError
from flightmech.fmu_export.fmu_file import find_libraries, place_libraries
from flightmech.support.input_files import file_sha256

FILES = (
    "aircraft/final.toml",
    "database/final.nc",
    "models/final.fmu",
    "report/manifest.json",
    "check_cases/states.csv",
    "README.md",
    "roadmap.csv",
    "recordings.csv",
)
REFUSED = {
    "database/final.mat": "a reason",
    "database/final_csv": "a reason",
    "database/final.dml": "a reason",
    "database/final_jsbsim.xml": "a reason",
    "check_cases/flown": "a reason",
}


@pytest.fixture
def delivery(tmp_path):
    """Return a folder with the structure of a package, without content."""
    folder = tmp_path / "package"
    for name in FILES:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name)
    write_manifest(folder)
    return folder


def write_manifest(folder, **changes):
    files = {}
    for name in FILES:
        if (folder / name).is_file():
            files[name] = file_sha256(folder / name)
    content = {
        "content": CONTENT,
        "title": "x",
        "revision": "",
        "version": "1",
        "platforms": ["linux64"],
        "files": files,
        "refused": REFUSED,
    } | changes
    (folder / "manifest.json").write_text(json.dumps(content))


def faults(folder):
    return {item.name: item.detail for item in check_structure(folder) if not item.good}


def test_structure_of_a_package(delivery):
    assert faults(delivery) == {}
    (delivery / "link").symlink_to("/etc/passwd")
    os.mkfifo(delivery / "pipe")
    (delivery / "x\n   flown: 9 of 9 hold").write_text("")
    (delivery / FILES[4]).unlink()
    write_manifest(delivery, refused={}, files={"../../x": "0" * 64, "y": "short"})
    found = faults(delivery)
    assert set(found) == {
        "link",
        "pipe",
        "'x\\n   flown: 9 of 9 hold'",
        "check_cases/states.csv",
        "'../../x'",
        "y",
        *REFUSED,
    }
    # and no later stage is reached
    assert {item.kind for item in verify_package(delivery)} == {"structure"}


def test_a_link_is_named_where_no_link_can_be_made(delivery, monkeypatch):
    """Windows lets only some users make links."""

    def refuse(path, target):
        raise OSError(22, "a required privilege is not held")

    (delivery / "link").symlink_to("/etc/passwd")
    monkeypatch.setattr(Path, "symlink_to", refuse)
    with (
        pytest.raises(SchemaError, match="link is a link; a package has files and folders only"),
        unpack_package(delivery),
    ):
        pass


def test_a_changed_package_is_not_read_further(delivery):
    (delivery / FILES[0]).write_text("changed")
    found = list(verify_package(delivery))
    assert [(item.kind, item.name) for item in found if not item.good] == [("hash", FILES[0])]
    assert {item.kind for item in found} == {"structure", "hash"}


def test_a_zip_that_unpacks_to_many_times_its_size_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(package_opening, "_SMALL", 1000)
    with zipfile.ZipFile(tmp_path / "x.zip", "w", zipfile.ZIP_DEFLATED) as content:
        content.writestr("a/zeros", bytes(10**6))
    refused = pytest.raises(SchemaError, match="at most 100 times as much")
    with refused, unpack_package(tmp_path / "x.zip"):
        pass


def test_a_zip_of_another_compression_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "x.zip", "w", zipfile.ZIP_LZMA) as content:
        content.writestr("a/manifest.json", "{}")
    refused = pytest.raises(SchemaError, match="not packed as a data package is")
    with refused, unpack_package(tmp_path / "x.zip"):
        pass


@pytest.mark.slow
def test_readers_that_fail_are_findings(delivery):
    found = list(verify_package(delivery))
    assert all(item.good for item in check_hashes(delivery))
    bad = [item for item in found if not item.good]
    assert {item.kind for item in bad} == {"states"}
    assert bad[-1].detail == "it gave no complete result"


@pytest.mark.parametrize(
    ("members", "text"),
    [
        (["a/manifest.json", "a/manifest.json"], "two files are named 'a/manifest.json'"),
        (["a/../../x"], "leads out of the package"),
        (["a\\..\\x"], "leads out of the package"),
        (["a/manifest.json", "b/x"], "more than one folder"),
        (["a/manifest.json", "x"], "more than one folder"),
    ],
)
def test_members_of_a_zip(members, text, tmp_path):
    with (
        zipfile.ZipFile(tmp_path / "x.zip", "w") as content,
        pytest.warns(UserWarning, match="Duplicate")
        if len({*members}) < len(members)
        else nullcontext(),
    ):
        for name in members:
            content.writestr(name, "{}")
    with pytest.raises(SchemaError, match=text), unpack_package(tmp_path / "x.zip"):
        pass


def test_a_damaged_zip_is_refused(delivery, tmp_path):
    archive = Path(shutil.make_archive(str(tmp_path / "x"), "zip", tmp_path, "package"))
    raw = bytearray(archive.read_bytes())
    at = raw.index(b"manifest.json") + 20
    raw[at : at + 5] = b"\xff" * 5
    archive.write_bytes(raw)
    with pytest.raises(SchemaError, match="a damaged zip"), unpack_package(archive):
        pass


def sign(folder, key):
    text = signature_text((folder / "manifest.json").read_bytes(), read_private_key(key))
    (folder / "manifest.sig").write_text(text)
    return text


def test_signatures(delivery, tmp_path):
    ours, fingerprint = make_key(tmp_path / "ours")
    others, _ = make_key(tmp_path / "others")
    assert (tmp_path / "ours").stat().st_mode & 0o777 == 0o600
    assert check_signature(delivery, [ours]) == PackageSignature("none", "not signed")
    assert sign(delivery, tmp_path / "ours") == sign(delivery, tmp_path / "ours")
    # the signature is not a file of the manifest, and not a finding
    assert all(item.good for item in check_hashes(delivery))
    known = PackageSignature("known", f"signed by the known key ours.pub ({fingerprint})")
    assert check_signature(delivery, [others, ours]) == known
    assert check_signature(delivery, [others]).state == "unknown"
    assert check_signature(delivery).state == "unknown"
    text = (delivery / "manifest.json").read_text()
    (delivery / "manifest.json").write_text(text + " ")
    assert check_signature(delivery, [ours]).state == "broken"
    for broken in ("", "{}", "[" * 5000, text):
        (delivery / "manifest.sig").write_text(broken)
        assert check_signature(delivery, [ours]).state == "broken"
    # the key of another person in place of ours does not help
    (delivery / "manifest.json").write_text(text)
    sign(delivery, tmp_path / "others")
    assert check_signature(delivery, [ours]).state == "unknown"


def key_killed_at_each_call(folder):
    """Make a key, killed at each call that writes; the next run completes the pair."""
    private = folder / "key"
    for _ in write_calls.each_call(lambda: make_key(private), folder):
        public = folder / "key.pub"
        if not public.exists():
            make_key(private)
        assert private.stat().st_mode & 0o777 == 0o600
        assert read_private_key(private).public_key() == read_public_key(public)
        assert sorted(path.name for path in folder.iterdir()) == ["key", "key.pub"]
        private.unlink()
        public.unlink()


@pytest.mark.slow
@pytest.mark.nightly
def test_a_killed_run_leaves_no_half_of_a_key(tmp_path):
    write_calls.run_preloaded(key_killed_at_each_call, tmp_path)


def test_the_public_key_is_written_again_from_the_private_one(tmp_path):
    public, fingerprint = make_key(tmp_path / "key")
    before = public.read_bytes()
    public.unlink()
    assert make_key(tmp_path / "key") == (public, fingerprint)
    assert public.read_bytes() == before


def test_keys_that_are_none_are_refused(tmp_path):
    make_key(tmp_path / "key")
    with pytest.raises(SchemaError, match="a key is not overwritten"):
        make_key(tmp_path / "key")
    curve = generate_private_key(SECP256R1())
    (tmp_path / "curve").write_bytes(
        curve.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
    )
    locked = read_private_key(tmp_path / "key").private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.BestAvailableEncryption(b"x"),
    )
    (tmp_path / "locked").write_bytes(locked)
    for name in ("curve", "key.pub"):
        with pytest.raises(SchemaError, match="not a private key of Ed25519"):
            read_private_key(tmp_path / name)
    with pytest.raises(SchemaError, match="without a password"):
        read_private_key(tmp_path / "locked")
    with pytest.raises(SchemaError, match="not a public key of Ed25519"):
        read_public_key(tmp_path / "key")


@pytest.mark.slow
def test_the_first_line_separates_consistent_from_signed(delivery, tmp_path):
    public, fingerprint = make_key(tmp_path / "ours")
    good = [PackageCheck("hash", "x", good=True)]
    bad = [PackageCheck("hash", "x", good=False)]

    def line(checks, *trusted):
        signature = check_signature(delivery, trusted)
        state = check_package_signature(signature, bool(trusted))
        return describe_verdict([*state, *checks], signature), all(item.good for item in state)

    assert line(good) == (
        "MAKER NOT PROVEN, consistent with itself; not signed, so anyone can have made it",
        True,
    )
    assert line(good, public)[1] is False
    sign(delivery, tmp_path / "ours")
    unknown = f"signed by an unknown key ({fingerprint}), which proves nothing about its maker"
    assert line(good) == (
        f"MAKER NOT PROVEN, consistent with itself; {unknown}: give --trusted-key",
        True,
    )
    known = f"signed by the known key ours.pub ({fingerprint})"
    assert line(good, public) == (f"{known}, and consistent with itself", True)
    assert line(bad, public) == (f"does NOT hold: 1 findings (hash); {known}", True)
    done = CliRunner().invoke(
        package, ["verify", str(delivery), "--trusted-key", str(public), "--json"]
    )
    found = json.loads(done.output)
    assert (found["signature"], found["holds"], done.exit_code) == ("known", False, 1)


def make_fmu(path, files, identifier="model", version="2.0"):
    with zipfile.ZipFile(path, "w") as content:
        content.writestr(
            "modelDescription.xml",
            f'<fmiModelDescription fmiVersion="{version}" modelName="x" guid="x">'
            f'<CoSimulation modelIdentifier="{identifier}"/></fmiModelDescription>',
        )
        for name, data in files.items():
            content.writestr(name, data)
    return path


def test_only_the_installed_library_is_ours(tmp_path):
    own = place_libraries(find_libraries(), "model", "2.0")
    (name,) = [item for item in own if item.endswith(".so")][:1]
    folder = name.rpartition("/")[0]
    fmu = tmp_path / "x.fmu"
    assert foreign_library(make_fmu(fmu, own)) == ""
    changed = own[name][:-1] + bytes([own[name][-1] ^ 1])
    assert "not the installed library" in foreign_library(make_fmu(fmu, {**own, name: changed}))
    more = {**own, f"{folder}/libc.so.6": b"x"}
    assert "libc.so.6" in foreign_library(make_fmu(fmu, more))
    # the importer would load a library that lies elsewhere
    elsewhere = {**own, "resources/evil.so": b"x"}
    assert "identifier" in foreign_library(make_fmu(fmu, elsewhere, "../../resources/evil"))
    assert "no library" in foreign_library(make_fmu(fmu, {}))
    assert "FMI" in foreign_library(make_fmu(fmu, own, version="1.0"))
    assert "cannot be read" in foreign_library(tmp_path / "none.fmu")


@pytest.mark.slow
def test_an_fmu_without_a_library_gives_a_text(tmp_path):
    time = np.arange(3) / 50.0
    names = (*OUTPUTS, *flown_checks.CONTROLS)
    case = xr.Dataset({name: ("time", 0.0 * time) for name in names}, {"time": time})
    facts = dict.fromkeys((*flown_checks._MASS, *flown_checks._AIR), 0.0)
    flights = fly_cases_by_fmu(make_fmu(tmp_path / "x.fmu", {}), [(case, facts)] * 2)
    assert [isinstance(item, str) and len(item) > 5 for item in flights] == [True, True]


def test_a_child_that_gives_no_answer_is_a_text():
    # this module answers nothing
    flights = fly_in_child("json.tool", [{"x": np.zeros(2)}], [(2, 1)], [])
    assert isinstance(flights[0], str)
    assert "exit code" in flights[0]


def test_elements_of_jsbsim_that_act_are_removed():
    root = ET.fromstring(
        """<fdm_config name="x" version="2.0"><aerodynamics file="/etc/passwd">
        <axis name="LIFT"><function name="a"><product><property>p</property><value>2</value>
        <random/></product></function></axis></aerodynamics>
        <flight_control name="x"><channel name="y" execrate="2"><aerosurface_scale name="s">
        <input>a</input><output>b</output></aerosurface_scale><socket/></channel></flight_control>
        <output name="/tmp/written.csv" type="CSV"><property>x</property></output>
        <input port="1137"/><propulsion><engine file="x"/></propulsion><system file="y"/>
        </fdm_config>"""
    )
    assert sorted(keep_written_elements(root)) == [
        "aerodynamics@file",
        "channel/socket",
        "channel@execrate",
        "fdm_config/input",
        "fdm_config/output",
        "fdm_config/propulsion",
        "fdm_config/system",
        "product/random",
    ]
    assert [item.tag for item in root] == ["aerodynamics", "flight_control"]
    # the element of the same name inside of a channel is kept
    assert root.find(".//aerosurface_scale/output").text == "b"
    assert keep_written_elements(root) == []


def test_a_readme_follows_from_a_manifest_that_was_read(tmp_path):
    facts = {
        "title": "T",
        "revision": "",
        "version": "0.1.0",
        "platforms": ["linux64"],
        # the order in which the files are made
        "refused": {"database/final_jsbsim.xml": "a reason", "check_cases/flown": "another one"},
    }
    read = json.loads(manifest_text(tmp_path, facts))
    text = readme_text(tmp_path, facts, [])
    assert text.count("a reason") == text.count("another one") == 1
    assert readme_text(tmp_path, read, []) == text
