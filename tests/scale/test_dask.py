"""Tiles and batches on Dask distributed: the same bits, also when workers are killed, and clear words when it fails."""

import builtins
import os
import signal
import sys

import numpy as np
import pytest
from scale_session import GRID, uneven_session

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.focus import default_grid, focus
from polfuse_lab.products.store import Products
from polfuse_lab.scale import cluster as cluster_module
from polfuse_lab.scale.batch import focus_batch
from polfuse_lab.scale.cluster import connect
from polfuse_lab.scale.spread import on_cluster
from polfuse_lab.session import open_session
from processing.errors import DataError

distributed = pytest.importorskip("distributed", reason="needs the extra 'dask'")

# Processes start and die in real time.
pytestmark = [pytest.mark.realtime, pytest.mark.filterwarnings("ignore")]


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    return uneven_session(tmp_path_factory.mktemp("rail") / "rail.h5")


@pytest.fixture(scope="module")
def grid(session):
    with open_session(session) as opened:
        return default_grid(opened, **GRID)


@pytest.fixture(scope="module")
def one_process(session, grid, tmp_path_factory):
    return focus(session, tmp_path_factory.mktemp("one") / "one.h5", grid=grid, method="bp").products


@pytest.fixture(scope="module")
def cluster():
    with connect("local", workers=2) as connected:
        yield connected


def digests(path):
    return [Products(path).provenance(stage)["sha256"] for stage in ("ranging", "focus")]


def listening_addresses(pid):
    """Local addresses (hexadecimal, proc(5) net/tcp) of a process' listening sockets."""
    inodes = set()
    for descriptor in os.listdir(f"/proc/{pid}/fd"):
        try:
            target = os.readlink(f"/proc/{pid}/fd/{descriptor}")
        except OSError:
            continue
        if target.startswith("socket:["):
            inodes.add(target[8:-1])
    found = []
    for table in ("tcp", "tcp6"):
        with open(f"/proc/{pid}/net/{table}") as lines:
            rows = [line.split() for line in list(lines)[1:]]
        found += [row[1].split(":")[0] for row in rows if row[3] == "0A" and row[9] in inodes]
    return found


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs /proc")
def test_a_local_cluster_listens_on_loopback_only(cluster):
    pids = [os.getpid(), *cluster.client.run(os.getpid).values(), *cluster.client.run(os.getpid, nanny=True).values()]
    addresses = [address for pid in pids for address in listening_addresses(pid)]
    assert addresses
    # 127.0.0.1 as the kernel writes it.
    assert set(addresses) == {"0100007F"}


def test_tiles_on_workers_have_the_bits_of_one_process_though_a_worker_is_killed(
    session, grid, one_process, cluster, tmp_path
):
    victims = list(cluster.client.run(os.getpid).values())
    killed = []

    def kill(told):
        if told.what == "tiles" and not killed:
            os.kill(victims[0], signal.SIGKILL)
            killed.append(victims[0])

    made = focus(session, tmp_path / "p.h5", grid=grid, method="bp", scale=on_cluster(cluster, tile=16, listener=kill))
    assert killed
    assert digests(made.products) == digests(one_process)


def test_a_batch_gives_the_products_of_one_process_and_tells_what_failed(session, grid, one_process, cluster, tmp_path):
    broken = tmp_path / "broken.h5"
    broken.write_bytes(b"nothing")
    seen = []
    options = {**GRID, "method": "bp"}
    made = focus_batch(
        [session, broken], tmp_path / "out", options=options, cluster=cluster, listener=lambda told: seen.append(told)
    )
    assert [item.error is None for item in made] == [True, False]
    assert "cannot be read" in made[1].error or "HDF5" in made[1].error
    assert digests(made[0].products) == digests(one_process)
    assert (seen[-1].done, seen[-1].total) == (2, 2)


def _data_error(number):
    if number == 3:
        raise DataError("three is no number", "take another")
    return np.arange(number)


def _die(number):
    os.kill(os.getpid(), signal.SIGKILL)


def test_errors_of_the_work_arrive_as_they_are(cluster):
    with pytest.raises(DataError, match="three is no number; take another"):
        list(cluster.each(_data_error, [(n,) for n in range(6)]))
    results = dict(cluster.each(_data_error, [(n,) for n in (0, 5, 7)]))
    assert [len(results[index]) for index in range(3)] == [0, 5, 7]


def test_no_scheduler_there(monkeypatch):
    monkeypatch.setattr(cluster_module, "CONNECT_S", 0.5)
    with (
        pytest.raises(PolfuseError, match=r"--dask tcp://127.0.0.1:9: no Dask scheduler answers there"),
        connect("tcp://127.0.0.1:9"),
    ):
        pass
    with pytest.raises(PolfuseError, match="no Dask scheduler answers there"), connect("nonsense://x"):
        pass


def test_other_versions_there_are_told(cluster, monkeypatch):
    monkeypatch.setattr(cluster_module, "versions", lambda: {"numpy": "0.1", "numba": "0.1"})
    with (
        pytest.raises(PolfuseError, match=r"has other versions: .*numpy \d\S* there, 0\.1 here"),
        connect(cluster.client.scheduler.address),
    ):
        pass


def test_the_extra_that_is_not_installed_is_told(monkeypatch):
    real = builtins.__import__

    def without(name, *rest):
        if name.partition(".")[0] == "distributed":
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(PolfuseError, match=r"pip install 'polfuse-lab\[dask\]'"), connect("local"):
        pass


def test_work_that_takes_every_worker_down_ends_with_a_reason(cluster):
    # Last: the workers come back one after the other.
    import dask

    with dask.config.set({"distributed.scheduler.allowed-failures": 0}):
        cluster.client.run_on_scheduler(_allow_no_failure)
        with pytest.raises(PolfuseError, match=r"took \d workers? down"):
            list(cluster.each(_die, [(1,)]))


def _allow_no_failure(dask_scheduler):
    dask_scheduler.allowed_failures = 0
