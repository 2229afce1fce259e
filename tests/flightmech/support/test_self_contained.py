"""Files whose numbers lie in other files are refused before a number is read."""

import os
import re

import h5py
import numpy as np
import pytest

import flighttest
import pom
from flightmech.errors import ParseError
from flightmech.support import hdf5_seal as self_contained
from flightmech.support.hdf5_seal import demand_self_contained


def external_link(file, other):
    file["imu"] = h5py.ExternalLink(other.name, "/imu")


def soft_link(file, other):
    file["again"] = h5py.SoftLink("/clock")


def external_storage(file, other):
    file.create_dataset("alpha", (8,), "f8", external=[(str(other), 0, h5py.h5f.UNLIMITED)])


def virtual(file, other):
    layout = h5py.VirtualLayout((3,), "f8")
    layout[:] = h5py.VirtualSource(str(other), "x", (3,))
    file.create_virtual_dataset("alpha", layout)


def circle(file, other):
    file["clock/up"] = file["/"]


def crowd(file, other):
    for number in range(self_contained.MOST_GROUPS + 1):
        file.create_group(f"groups/g{number}")


def text_in_place_of_dimensions(file, other):
    """HDF5 2.0 follows the characters of the text as addresses, and the process ends."""
    file["clock/p"].attrs["DIMENSION_LIST"] = "x" * 100


def dimensions_of_another_shape(file, other):
    references = np.empty(5, object)
    references[:] = [np.array([file["clock/time"].ref], h5py.ref_dtype)] * 5
    file["clock/p"].attrs.create(
        "DIMENSION_LIST", references, dtype=h5py.vlen_dtype(h5py.ref_dtype)
    )


def many_names_of_a_scale(file, other):
    """HDF5 2.0 writes all of them into the memory of the first."""
    file["clock/time"].make_scale("time")
    file["clock/time"].attrs["NAME"] = np.full(1000, b"a" * 50, "S50")


FAULTS = [
    (external_link, "/imu is a link into another file, other.h5"),
    (soft_link, "/again is a symbolic link"),
    (external_storage, "/alpha keeps its numbers in another file"),
    (virtual, "/alpha keeps its numbers in another file"),
    (circle, "the group /clock/up is linked to more than once"),
    (crowd, "more than 5000 groups"),
    (text_in_place_of_dimensions, "/clock/p has an attribute DIMENSION_LIST that is not a list"),
    (dimensions_of_another_shape, "/clock/p has an attribute DIMENSION_LIST that is not a list"),
    (many_names_of_a_scale, "/clock/time has an attribute NAME that is not one text"),
]


@pytest.fixture
def made(tmp_path):
    """Return a function: a file of a clock and samples, harmed."""
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["x"] = np.arange(3.0)
        other.create_group("imu")["p"] = np.arange(3.0)

    def make(harm=None):
        with h5py.File(tmp_path / "record.nc", "w") as file:
            group = file.create_group("clock")
            group["time"] = np.linspace(0.0, 1.0, 11)
            group["p"] = np.zeros(11)
            if harm:
                harm(file, tmp_path / "other.h5")
        return tmp_path / "record.nc"

    return make


@pytest.mark.nightly
@pytest.mark.parametrize(("harm", "text"), FAULTS)
def test_what_lies_elsewhere_is_named(made, harm, text):
    with pytest.raises(ParseError) as caught:
        demand_self_contained(made(harm))
    assert text in str(caught.value)


def test_a_file_that_another_thread_reads_is_looked_into(made):
    """HDF5 does not open a file with and without its lock at once: it would not open here, and
    pass.
    """
    path = made(FAULTS[0][0])
    with h5py.File(path, "r"), pytest.raises(ParseError, match=re.escape(FAULTS[0][1])):
        demand_self_contained(path)


def test_a_whole_file_passes_and_what_is_no_hdf5_is_left_to_its_reader(made, tmp_path):
    demand_self_contained(made())
    (tmp_path / "text.nc").write_text("no HDF5")
    demand_self_contained(tmp_path / "text.nc")


def test_a_heap_of_texts_without_an_end_is_refused(tmp_path):
    """HDF5 2.0 adds the size zero of the free space for ever."""
    path = tmp_path / "texts.nc"
    with h5py.File(path, "w") as file:
        file["text"] = ["a", "bc"]
    demand_self_contained(path)
    content = path.read_bytes()
    # the free space behind the two texts: 16 bytes of the heap, and twice a header and 8 bytes
    at = content.find(b"GCOL") + 16 + 2 * 24
    assert int.from_bytes(content[at + 8 : at + 16], "little") == 4096 - 64
    path.write_bytes(content[: at + 8] + bytes(8) + content[at + 16 :])
    with pytest.raises(ParseError, match="a damaged heap of texts at byte"):
        demand_self_contained(path)


@pytest.mark.parametrize(
    "read", [flighttest.read, flighttest.dynamics.open_states, pom.read_archive]
)
def test_readers_refuse_them(made, read):
    with pytest.raises(ParseError, match="keeps its numbers in another file"):
        read(made(external_storage))


@pytest.mark.parametrize(("harm", "text"), FAULTS[:5])
def test_the_reader_of_records_finds_them_in_its_own_walk(made, harm, text):
    with pytest.raises(ParseError, match=re.escape(text)):
        flighttest.read(made(harm))


def test_the_reader_of_records_does_not_follow_dimension_scales(made):
    """It calls no function of HDF5 that a false scale misleads."""

    def harm(file, other):
        text_in_place_of_dimensions(file, other)
        for name, unit in (("time", "s"), ("p", "rad/s")):
            file[f"clock/{name}"].attrs["units"] = unit
        file["clock/p"][:] = np.arange(11.0)

    record = flighttest.read(made(harm))
    assert record["clock/p"].values == pytest.approx(np.arange(11.0))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="a named pipe of POSIX")
def test_a_named_pipe_is_refused(tmp_path):
    """HDF5 would wait for its writer."""
    os.mkfifo(tmp_path / "deck.nc")
    with pytest.raises(ParseError, match="found a named pipe or a device"):
        demand_self_contained(tmp_path / "deck.nc")
