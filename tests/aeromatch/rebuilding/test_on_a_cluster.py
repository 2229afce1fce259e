"""Every parallel stage of a match on the workers of a cluster: the same bytes, also when workers
die.
"""

import os
import shutil
import signal
from collections import Counter
from contextlib import nullcontext

import pytest

from aeromatch.cli.actions.examples import example_folder
from aeromatch.project.project import read_project
from aeromatch.rebuilding.match_options import MatchOptions
from aeromatch.workflow.steps import perform_match
from flightmech.support.kept_stages.sharing import Cluster

pytestmark = [pytest.mark.slow, pytest.mark.serial, pytest.mark.nightly]
FIT = """
[[fit]]
name = "pitch"
records = ["cruise", "fast"]
manoeuvres = ["3211 elevator", "doublet elevator"]
models = ["CL = 1 + alpha + qhat + delta_e", "Cm = 1 + alpha + qhat + delta_e"]
"""


@pytest.fixture
def project(tmp_path):
    """A project of one fit on two records, and two cases."""
    folder = tmp_path / "project"
    shutil.copytree(example_folder("c182"), folder)
    for case in sorted((folder / "cases").glob("*.toml")):
        if case.stem not in ("short_period", "phugoid"):
            case.unlink()
    head = (folder / "aeromatch.toml").read_text(encoding="utf-8").partition("[[fit]]")[0]
    head = "".join(
        line for line in head.splitlines(keepends=True) if "/power" not in line
    )  # samples of it need a CT of the record
    (folder / "aeromatch.toml").write_text(head + FIT, encoding="utf-8")
    return read_project(folder / "aeromatch.toml")


def files(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_every_parallel_stage_goes_to_the_workers_and_dead_workers_change_nothing(
    project, tmp_path, monkeypatch
):
    distributed = pytest.importorskip(
        "distributed", reason="dask.distributed is not installed (extra `cluster`)"
    )
    options = {"jobs": 1, "step": lambda text: nullcontext(), "command": "match"}
    perform_match(project, tmp_path / "here", options=MatchOptions(samples=2), **options)
    sent, victims = Counter(), []
    submit, unordered = Cluster._submit, Cluster.unordered

    def counted(self, function, *call):
        name = (
            call[2].__name__ if function.__name__ == "_call_indexed" else function.__name__
        )  # after index and recorder
        sent[name] += 1
        return submit(self, function, *call)

    def killing(self, *rest):
        """Kill a worker as soon as the first result of a stage is there, three times."""
        for number, found in enumerate(unordered(self, *rest)):
            if number == 0 and len(victims) < 3:
                # a worker that was killed before may not have started again yet: it does not answer
                while not (alive := self._client.run(os.getpid, on_error="ignore")):
                    self._client.wait_for_workers(1)
                victims.append(min(alive.values()))
                os.kill(victims[-1], signal.SIGKILL)
            yield found

    monkeypatch.setattr(Cluster, "_submit", counted)
    monkeypatch.setattr(Cluster, "unordered", killing)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as local:
        replay = MatchOptions(local.scheduler_address, samples=2)
        perform_match(project, tmp_path / "there", options=replay, **options)
    assert len(victims) == 3
    stages = {
        "_solve_alone",
        "_refine_solution",
        "coefficients",
        "fit_local_models",
        "_diagnose_case",
        "_perform",
        "samples_of_case",
        "part_files",
    }
    assert stages <= sent.keys()
    assert files(tmp_path / "here") == files(tmp_path / "there")
