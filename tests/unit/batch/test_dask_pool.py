"""What Dask says of workers and schedulers that are gone, in the words of this program."""

from concurrent.futures import Future

import pytest

from motord.batch import dask_pool
from motord.batch.dask_pool import DaskPool
from motord.batch.error import BatchError, WorkerDiedError

ADDRESS = "tcp://there:8786"


class Cluster:
    """In place of Dask's. scaled: to how many workers, each time."""

    def __init__(self):
        self.workers, self.scaled = {}, []

    def scale(self, count):
        self.scaled.append(count)


class Client:
    """In place of Dask's. threads: of each worker."""

    status = "running"

    def __init__(self):
        self.threads, self.cluster = {}, Cluster()

    def nthreads(self):
        if self.threads is None:
            raise OSError("closed")
        return self.threads


@pytest.fixture
def remarks(monkeypatch):
    monkeypatch.setattr(dask_pool.time, "monotonic", iter(range(1, 1000, 2)).__next__)
    return []


def pool_of(client, remarks, scheduler=ADDRESS):
    pool = DaskPool(2, scheduler, remarks.append)
    pool._client = client
    return pool


def test_the_window_follows_the_workers(remarks):
    client = Client()
    pool = pool_of(client, remarks)
    windows = []
    for threads in ({}, {}, {"a": 1}, {"a": 1, "b": 8}, {}, {"a": 4}):
        client.threads = threads
        windows.append(pool.window())
    assert windows == [4, 4, 4, 18, 4, 8]
    assert remarks == [f"no worker at {ADDRESS}: waiting for one"] * 2


@pytest.mark.parametrize(("threads", "status"), [(None, "running"), ({"a": 1}, "connecting")])
def test_a_scheduler_that_is_gone_is_said(remarks, threads, status):
    client = Client()
    client.threads, client.status = threads, status
    with pytest.raises(BatchError, match=f"{ADDRESS} is gone; what is done is kept"):
        pool_of(client, remarks).window()


def test_why_workers_cannot_be_had_is_said_when_they_are_needed(remarks, monkeypatch):
    def refused(_address):
        raise BatchError("nobody answers")

    monkeypatch.setattr(dask_pool, "_remote", refused)
    with DaskPool(2, ADDRESS, remarks.append) as pool:
        pool.begin()
        pool.begin()
        for _ in range(2):
            with pytest.raises(BatchError, match="nobody answers"):
                pool.window()


def test_workers_that_do_not_start_here_end_it(remarks):
    client = Client()
    pool = pool_of(client, remarks, scheduler=None)
    client.threads = {"a": 1}
    assert pool.window() == dask_pool.LEAST_WINDOW
    client.threads = {}
    with pytest.raises(BatchError, match="no worker has started for 60 s"):
        [pool.window() for _ in range(100)]


def test_workers_that_dask_has_given_up_are_replaced_here_and_nowhere_else(remarks):
    client = Client()
    client.threads = {"a": 1}
    for present, scaled in (({0: None, 1: None}, []), ({1: None}, [2])):
        client.cluster.workers = present
        pool_of(client, remarks, scheduler=None).window()
        assert client.cluster.scaled == scaled
    client.cluster = None
    pool_of(client, remarks).window()


@pytest.mark.parametrize(
    ("error", "kind", "why"),
    [
        (OSError("closed"), BatchError, "is gone"),
        (ModuleNotFoundError("no motord"), BatchError, "does it have motord"),
        (BatchError("a worker has motord 1"), BatchError, "^a worker has motord 1$"),
    ],
)
def test_how_a_job_ended(remarks, error, kind, why):
    ended_with(error, remarks, kind, why)


def test_a_job_whose_worker_died(remarks):
    from distributed import KilledWorker  # 0.4 s, of whoever collects

    ended_with(KilledWorker("task", None, 1), remarks, WorkerDiedError, "^$")


def ended_with(error, remarks, kind, why):
    future = Future()
    future.set_exception(error)
    with pytest.raises(kind, match=why):
        pool_of(Client(), remarks).result(future)


def test_a_job_that_is_cancelled_has_lost_its_scheduler(remarks):
    future = Future()
    future.cancel()
    with pytest.raises(BatchError, match="is gone"):
        pool_of(Client(), remarks).result(future)


def test_tls_without_keys_is_refused():
    pool = DaskPool(1, "tls://there:8786", print)
    with pytest.raises(BatchError, match="no keys; Dask's configuration"):
        pool.window()
