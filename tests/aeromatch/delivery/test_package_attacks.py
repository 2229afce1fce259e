"""Packages changed by hand: every key and file of the manifest, names, zips, changes under way."""

import copy
import json
import os
import re
import shutil
import struct
import zipfile
import zlib
from contextlib import nullcontext
from importlib.metadata import version
from pathlib import Path

import pytest
from scipy.io import loadmat, savemat

import aerodb
import flightmech
from aerodb.exchange.tables.csv_checks import export_checkcases
from aeromatch.cli.actions import delivery as delivery_action
from aeromatch.delivery import contents, package_numbers, package_opening, verification
from aeromatch.delivery.package_files import check_hashes, check_structure
from aeromatch.delivery.package_numbers import export_formats
from aeromatch.delivery.package_opening import unpack_package
from aeromatch.delivery.places import CONTENT, FORMATS, STATE_COUNT, STATES
from aeromatch.delivery.signing import check_signature, make_key, read_private_key, signature_text
from aeromatch.workflow.steps import REPORT
from flightmech.errors import AeromatchError, ParseError, SchemaError
from flightmech.support.input_files import file_sha256
from flightmech.support.temporary_names import temporary_name
from flightmech.terms import make_term

C182 = Path(__file__).parents[3] / "data" / "c182"
FILES = (
    "aircraft/final.toml",
    "database/final.nc",
    "database/final.mat",
    "models/final.fmu",
    "report/manifest.json",
    "check_cases/states.csv",
    "README.md",
    "roadmap.csv",
    "recordings.csv",
)


@pytest.fixture
def delivery(tmp_path):
    """Return a folder whose structure and hashes hold; its files have no content of their own."""
    folder = tmp_path / "package"
    for name in FILES:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(f"content of {name}")
    manifest = {
        "content": CONTENT,
        "title": "T-37",
        "revision": "A",
        "version": "0.1.0",
        "platforms": ["linux64", "win64"],
        "refused": {name: "a reason" for name in FORMATS if name not in FILES},
        "files": {name: file_sha256(folder / name) for name in FILES},
    }
    write(folder, manifest)
    return folder


def write(folder, manifest):
    (folder / "manifest.json").write_text(json.dumps(manifest))


def faults(package):
    """Return the findings of structure and hashes, or the refusal."""
    try:
        with unpack_package(package) as folder:
            structure = check_structure(folder)
            found = [item for item in structure if not item.good]
            return found or [item for item in check_hashes(folder) if not item.good]
    except AeromatchError as error:
        return [error]


def other_values(value):
    """Yield values in place of one of a manifest."""
    yield from (None, 7, [], {}, [value], {"x": value}, True)
    if isinstance(value, str):
        yield from (
            value + " ",
            value[:-1] + "\0",
            value.swapcase() + "\u202e",
            value.encode().hex(),
        )


def mutations(manifest):
    """Yield a name and a manifest with one change: every key at every level left out, under another
    name, and with other values.
    """
    places = [(), ("files",), ("refused",)]
    for place in places:
        table = manifest
        for key in place:
            table = table[key]
        for key, value in table.items():
            for number, change in enumerate(("leave out", "rename", *other_values(value))):
                changed = copy.deepcopy(manifest)
                target = changed
                for step in place:
                    target = target[step]
                if number == 0:
                    del target[key]
                elif number == 1:
                    target[key + "x"] = target.pop(key)
                else:
                    target[key] = change
                yield f"{'/'.join((*place, key))}: {change!r}", changed
        changed = copy.deepcopy(manifest)
        target = changed
        for step in place:
            target = target[step]
        target["more"] = "x"
        yield f"{'/'.join(place)}: one more", changed


# Free texts: the README states them, which is compared where the results are read.
STATED_IN_README = ("title", "revision", "version", "refused/")


@pytest.mark.nightly
def test_every_change_of_a_manifest_is_refused(delivery, tmp_path):
    public, _ = make_key(tmp_path / "key")
    manifest = json.loads((delivery / "manifest.json").read_text())
    assert faults(delivery) == []
    signature = signature_text(
        (delivery / "manifest.json").read_bytes(), read_private_key(tmp_path / "key")
    )
    (delivery / "manifest.sig").write_text(signature)
    count, texts = 0, 0
    for name, changed in mutations(manifest):
        write(delivery, changed)
        count += 1
        assert check_signature(delivery, [public]).state == "broken", name
        if not faults(delivery):
            texts += 1
            assert name.startswith(STATED_IN_README), name
    # four other texts for each of title, revision, version and four reasons
    assert (count, texts) == (251, 28)


@pytest.mark.parametrize("text", ["[]", "[" * 100000, '{"files": {}} x', "\ufeff{}"])
def test_an_error_names_the_package_and_not_the_copy(delivery, text):
    (delivery / "manifest.json").write_text(text, encoding="utf-8")
    with pytest.raises(ParseError) as caught, unpack_package(delivery) as folder:
        check_structure(folder)
    assert caught.value.file == f"{delivery}: manifest.json"


@pytest.mark.parametrize("name", ["title", "revision", "refused"])
def test_a_text_that_no_file_can_hold_is_refused(delivery, name):
    text = (delivery / "manifest.json").read_text()
    manifest = json.loads(text)
    half = "\ud800"
    manifest[name] = {FORMATS[-1]: half} if name == "refused" else half
    write(delivery, manifest)
    assert any(name in str(fault) for fault in faults(delivery))


def test_a_key_that_stands_twice_is_refused(delivery):
    text = (delivery / "manifest.json").read_text()
    for twice in ('{"title": "other", ', '{"files": {}, '):
        (delivery / "manifest.json").write_text(text.replace("{", twice, 1))
        assert "twice" in str(faults(delivery)[0])
    name = json.dumps(FILES[0])
    (delivery / "manifest.json").write_text(text.replace(name, f'{name}: "0", {name}', 1))
    assert "twice" in str(faults(delivery)[0])


@pytest.mark.nightly
def test_every_file_changed_swapped_renamed_truncated_or_linked_is_a_finding(delivery, tmp_path):
    original = tmp_path / "original"
    shutil.copytree(delivery, original)
    (tmp_path / "outside").write_text("x")

    def changes(path, other):
        raw = path.read_bytes()
        yield lambda: path.write_bytes(raw[:-1])
        yield lambda: path.write_bytes(b"")
        yield lambda: path.write_bytes(raw + b"\0")
        yield lambda: path.write_bytes(bytes([raw[0] ^ 1]) + raw[1:])
        yield lambda: path.write_bytes(other.read_bytes())
        yield path.unlink
        yield lambda: path.rename(path.with_name(path.name.upper() + "_"))
        yield lambda: (path.unlink(), path.symlink_to(original / path.relative_to(delivery)))
        yield lambda: (path.unlink(), path.symlink_to("/dev/zero"))
        yield lambda: (path.unlink(), os.mkfifo(path))
        yield lambda: (path.unlink(), path.mkdir())
        # the size of a disk: it must be refused before a byte is read
        yield lambda: os.truncate(path, 10**13)

    count = 0
    for number, name in enumerate(FILES):
        path, other = delivery / name, delivery / FILES[number - 1]
        for change in changes(path, other):
            change()
            assert faults(delivery), (name, change)
            count += 1
            shutil.rmtree(delivery)
            shutil.copytree(original, delivery)
    assert faults(delivery) == []
    assert count == 12 * len(FILES)


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("readme.MD", "other systems take it for"),
        ("REPORT/x", "other systems take it for"),
        ("roadmap.csv.", "other systems take it for"),
        ("roadmap.csv ", "other systems take it for"),
        ("roadmap.csv:stream", "other systems take it for"),
        ("\uff52oadmap.csv", "other systems take it for"),  # a wide letter r
        ("more.txt", "not of the package"),
        ("models/other.fmu", "not of the package"),
        ("a\nb", "control characters"),
        ("a\u202eb", "control characters"),
        ("C:more", "Windows does not allow"),
        ("models/nul.fmu", "Windows does not allow"),
    ],
)
def test_more_files(delivery, name, word):
    (delivery / name).parent.mkdir(exist_ok=True)
    (delivery / name).write_text("x")
    assert any(word in item.detail for item in faults(delivery))
    # with its hash in the manifest it still is another name of a file, or no plain name
    manifest = json.loads((delivery / "manifest.json").read_text())
    manifest["files"][name] = file_sha256(delivery / name)
    write(delivery, manifest)
    assert (faults(delivery) == []) == (word == "not of the package")


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["a" * 70_000, "../" + "a" * 70_000])
def test_a_long_name_of_a_manifest_is_refused_and_not_printed(delivery, name):
    manifest = json.loads((delivery / "manifest.json").read_text())
    manifest["files"][name] = "0" * 64
    write(delivery, manifest)
    found = check_structure(delivery)
    assert [item.good for item in found] == [False]
    assert len(found[0].name + found[0].detail) < 300


def test_folders_in_many_folders_are_refused(delivery):
    deep = delivery.joinpath(*["a"] * 1500)
    os.makedirs(delivery / "b")
    # makedirs is recursive; each step is one folder
    place = delivery
    for _ in range(1500):
        place = place / "a"
        place.mkdir()
    assert place == deep
    assert "folders in more than 30 folders" in str(faults(delivery)[0])
    while place != delivery:  # rmtree is recursive, too
        place.rmdir()
        place = place.parent


def pack(folder, target, **options):
    """Write a package as a zip, with further members."""
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as content:
        for file in sorted(item for item in folder.rglob("*") if item.is_file()):
            content.write(file, f"data_package/{file.relative_to(folder).as_posix()}")
        for name, data in options.get("more", {}).items():
            content.writestr(name, data)
    return target


def test_zips_that_two_programs_read_differently_are_refused(delivery, tmp_path):
    good = pack(delivery, tmp_path / "good.zip")
    assert faults(good) == []
    raw = good.read_bytes()
    link = zipfile.ZipInfo("data_package/README.md2")
    link.external_attr = 0o120777 << 16
    members = {
        "links": {link: "README.md"},
        "dots": {"data_package/./README.md": "x"},
        "slashes": {"data_package//README.md": "x"},
        "absolute": {"/README.md": "x"},
        "deep": {"data_package/" + "a/" * 40 + "x": "x"},
        "inner": {"manifest.json": (delivery / "manifest.json").read_bytes()},
        "folder": {"data_package/README.md/": ""},
        "long": {f"data_package/{'a' * 300}": "x"},
    }
    words = {"links": "is a link", "dots": "plain name", "slashes": "plain name"}
    words |= {"absolute": "leads out", "deep": "more than 30 folders"}
    words |= {"folder": "two files are named", "long": "long.zip: 1 problem"}
    for name, more in members.items():
        found = faults(pack(delivery, tmp_path / f"{name}.zip", more=more))
        assert words.get(name, "") in str(found[0]), name
    # a manifest next to the folder of the package is the one that counts: nothing escapes it
    inner = faults(tmp_path / "inner.zip")
    assert any(item.name.startswith("data_package/") or "missing" in item.detail for item in inner)
    # another zip before it, and a member that its directory does not list
    comment = raw[:-2] + b"\x04\0more"
    all_harmed = {"two": raw + raw, "before": b"MZ" + raw, "behind": raw + b"more"}
    for name, harmed in (all_harmed | {"comment": comment}).items():
        (tmp_path / f"{name}.zip").write_bytes(harmed)
        assert "belong to none of its members" in str(faults(tmp_path / f"{name}.zip")[0]), name
    hidden = tmp_path / "hidden.zip"
    shutil.copy(good, hidden)
    with zipfile.ZipFile(hidden, "a") as content:
        content.writestr("data_package/hidden.txt", "x" * 100)
        entry = content.infolist()[-1]
        content.filelist.remove(entry)
        del content.NameToInfo[entry.filename]
    assert "belong to none of its members" in str(faults(hidden)[0])


def test_a_second_name_of_a_member_is_refused(delivery, tmp_path):
    """The field "Unicode path", which Info-ZIP and Python from 3.12 on use in place of the name."""
    other = b"data_package/../evil"
    field = struct.pack("<BI", 1, zlib.crc32(b"data_package/x")) + other
    member = zipfile.ZipInfo("data_package/x")
    member.extra = struct.pack("<HH", 0x7075, len(field)) + field
    file = pack(delivery, tmp_path / "a.zip", more={member: "x"})
    assert re.search("second name in an extra field|leads out of the package", str(faults(file)[0]))
    raw = file.read_bytes()
    # in front of the member alone: another kind in the directory
    directory = raw.rindex(b"up", 0, raw.rindex(other))
    file.write_bytes(raw[:directory] + b"xx" + raw[directory + 2 :])
    assert "'data_package/x' has a second name in an extra field" in str(faults(file)[0])


@pytest.mark.nightly
def test_every_byte_of_a_zip(delivery, tmp_path):
    """A changed byte of a zip is refused, or changes nothing that is read."""
    good = pack(delivery, tmp_path / "good.zip")
    raw = good.read_bytes()
    refused = 0
    for at in range(0, len(raw), 3):
        (tmp_path / "x.zip").write_bytes(raw[:at] + bytes([raw[at] ^ 0x55]) + raw[at + 1 :])
        refused += bool(faults(tmp_path / "x.zip"))
    # the rest are dates, versions and attributes of the members
    assert refused > 0.6 * (len(raw) // 3), refused


def test_a_file_that_changes_during_verification_is_not_read_again(delivery, monkeypatch):
    """The hashes are compared, then another program writes: the stages after it read the copy."""
    read = []

    def change_then_read(folder):
        for name in FILES:
            (delivery / name).write_text("changed after its hash was compared")
        (delivery / "manifest.json").unlink()
        for name in FILES:
            read.append((folder / name).read_text())
        return []

    monkeypatch.setattr(verification, "check_numbers", change_then_read)
    monkeypatch.setattr(verification, "_check_flights", lambda folder, fly_foreign: [])
    with unpack_package(delivery) as folder:
        found = list(verification.verify_package(folder))
    assert all(item.good for item in found)
    assert read == [f"content of {name}" for name in FILES]


def test_a_file_that_becomes_a_link_while_it_is_copied_is_not_followed(delivery, monkeypatch):
    (delivery.parent / "secret").write_text("secret")
    copy = package_opening._copy_file

    def link_then_copy(source, target, most):
        if source.name == "README.md":
            source.unlink()
            source.symlink_to(delivery.parent / "secret")
        return copy(source, target, most)

    monkeypatch.setattr(package_opening, "_copy_file", link_then_copy)
    with pytest.raises(SchemaError, match="changed while it was read"), unpack_package(delivery):
        pass


def test_a_file_that_grows_while_it_is_copied_has_an_end(delivery, monkeypatch):
    monkeypatch.setattr(package_opening, "MOST_BYTES", 3_000_000)
    with (delivery / "README.md").open("wb") as stream:
        stream.truncate(2_000_000)
    assert package_opening._copy_file(delivery / "README.md", delivery / "copy", 10**7) == 2_000_000
    (delivery / "copy").unlink()
    with (delivery / "more").open("wb") as stream:
        stream.truncate(2_000_000)
    with pytest.raises(SchemaError, match="more than 3e\\+06 bytes"), unpack_package(delivery):
        pass


def test_a_zip_whose_process_was_killed_leaves_nothing_behind_the_next(tmp_path, monkeypatch):
    for name in ("final.nc", "final.toml", "final.fmu", f"{REPORT}/manifest.json"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.setattr(os, "getpid", lambda: 2**30)  # a process that is not running
    left = tmp_path / temporary_name(".p.zip", "part.d")
    monkeypatch.undo()
    left.mkdir()
    (left / "final.mat").touch()
    monkeypatch.setattr(
        contents, "_fill", lambda folder, *_, **__: {"a": str(list(folder.iterdir()))}
    )
    wishes = contents.PackageOptions()
    done = contents.write_package(None, tmp_path, tmp_path / "p.zip", wishes, nullcontext)
    assert done == {"a": "[]"}
    assert [path.name for path in tmp_path.glob("*p.zip*")] == ["p.zip"]


@pytest.mark.slow
def test_formats_that_differ_where_no_state_looks(tmp_path):
    """Standard errors, further variables and one state many times are found."""
    aircraft = flightmech.read_aircraft(C182 / "aircraft.toml")
    leaf = make_term([0.1, 0.5], {"alpha": [0.0, 0.1]}, stderr=[0.01, 0.01])
    facts = {"S": 16.2, "cbar": 1.5, "b": 10.9, "x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0}
    named = {"title": "C182", "aircraft": "C182", "force_axes": "stability"}
    database = aerodb.make_database({"CL/basic": leaf}, **named, **facts)
    (tmp_path / "aircraft").mkdir()
    shutil.copy(C182 / "aircraft.toml", tmp_path / "aircraft/final.toml")
    assert set(export_formats(tmp_path / "database", database, aircraft)) <= {*FORMATS}
    aerodb.save(database, tmp_path / "database/final.nc")

    def wrong():
        checks = package_numbers._compare_formats(tmp_path, version("aeromatch"))
        return [check.name.partition(",")[0] for check in checks if not check.good]

    assert wrong() == []
    (other,) = package_numbers._compare_formats(tmp_path, "0.0.9")
    assert other.detail.startswith("not compared: written by version 0.0.9")
    assert delivery_action._is_shown(other)
    (table,) = (tmp_path / "database/final_csv").glob("*CL_basic.csv")
    table.write_text(table.read_text().replace(",0.01\n", ",0.0001\n"))
    mat = tmp_path / "database/final.mat"
    arrays = {key: value for key, value in loadmat(mat).items() if not key.startswith("__")}
    # packed in another way, with the same arrays
    savemat(mat, arrays, long_field_names=True)
    assert wrong() == ["database/final_csv"]
    savemat(mat, {**arrays, "more": 1.0}, long_field_names=True)
    assert wrong() == ["database/final.mat", "database/final_csv"]
    states = tmp_path / STATES
    states.parent.mkdir()
    export_checkcases(database, states, STATE_COUNT)
    assert package_numbers._check_coverage(tmp_path).good
    lines = states.read_text().splitlines()
    first = lines[-STATE_COUNT].partition(",")[2]
    same = [f"{line.partition(',')[0]},{first}" for line in lines[-STATE_COUNT:]]
    states.write_text("\n".join([*lines[:-STATE_COUNT], *same, ""]))
    assert package_numbers._check_coverage(tmp_path).detail == "200 states, 1 of them different"
