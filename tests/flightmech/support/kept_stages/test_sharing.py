"""Calls on a cluster."""

import operator

import pytest

from flightmech.support.kept_stages.sharing import Cluster

distributed = pytest.importorskip("distributed")


@pytest.mark.serial
def test_more_calls_than_the_cluster_takes_at_once_all_return():
    """One core takes four calls at a time; none of the ten is lost."""
    calls = [(i, i) for i in range(10)]
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        results = dict(Cluster(client).unordered(operator.mul, calls, jobs=1, threads=False))
    assert results == {i: i * i for i in range(10)}
