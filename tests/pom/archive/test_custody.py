"""A file that is replaced while a batch runs lends its hash to nothing."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from flightmech.errors import SchemaError
from pom.archive.archive import Custody
from pom.archive.origins import file_sha256
from pom.cases.case import read_case
from pom.fmu import process
from pom.fmu.models import Models
from pom.fmu.run_cache import RunCache
from pom.replaying import batch
from pom.replaying.replay_case import perform_plan, plan_of


def swapped(file, other):
    """Put other bytes in the place of a file, with its size and its time of modification."""
    before = file.stat()
    part = file.with_suffix(".part")
    part.write_bytes(other)
    os.truncate(part, before.st_size)
    os.utime(part, ns=(before.st_atime_ns, before.st_mtime_ns))
    part.replace(file)


def test_the_first_hash_counts_and_a_swap_is_found_even_when_it_is_taken_back(tmp_path):
    file = tmp_path / "record.csv"
    file.write_bytes(b"flight")
    custody = Custody()
    custody.take([file])
    custody.check()
    first = file_sha256(file)
    swapped(file, b"forged")
    assert custody.sha256(file) == first
    swapped(file, b"flight")
    with pytest.raises(
        SchemaError, match=r"record\.csv changed while the batch ran; nothing was written"
    ):
        custody.check()
    file.unlink()
    with pytest.raises(SchemaError, match="changed while the batch ran"):
        custody.check()


def test_an_fmu_that_changed_after_it_was_read_flies_for_nothing(
    write_case, lag_states, toy, tmp_path, monkeypatch
):
    own = Path(shutil.copy(toy(), tmp_path / "own.fmu"))
    kept = tmp_path / "kept"
    run = process.Child.run

    def swap_first(self, *arguments):
        reply = run(self, *arguments)
        swapped(own, toy("nan").read_bytes())
        return reply

    monkeypatch.setattr(process.Child, "run", swap_first)
    case = read_case(write_case(more="trim = false"))
    result = perform_plan(
        plan_of(case, lag_states), Models({"toy": own}).of(case), 60.0, RunCache(kept)
    )
    assert result.status("toy") == "invalid"
    assert result.failure == "toy: own.fmu changed after it was read; run the batch again"
    assert not list(kept.rglob("*.flight"))  # what flew is kept under no hash
    assert np.isnan(result.signals["theta"].sel(run="toy")).all()


@pytest.mark.slow
def test_a_record_that_changed_while_the_batch_ran_is_refused_before_anything_is_written(
    aeromatch, write_case, lag_states, toy, tmp_path, monkeypatch
):
    case = write_case(more="trim = false")
    lag_states.to_netcdf(tmp_path / "record.nc", engine="h5netcdf")
    perform = batch.perform_plan

    def later(*arguments):
        (tmp_path / "record.nc").touch()
        return perform(*arguments)

    monkeypatch.setattr(batch, "perform_plan", later)
    done = aeromatch(
        "pom", "run", case, "--model", f"toy={toy()}", "-o", tmp_path / "report", "--no-pdf"
    )
    assert done.returncode == 2
    assert "record.nc changed while the batch ran; nothing was written" in done.stderr
    assert not (tmp_path / "report").exists()
