"""Workers of Dask's that die at any moment: each chunk has its own result, or is known to kill."""

import os
import random
import signal
import time
from collections import Counter
from concurrent.futures import wait

import pytest

from motord.batch import dask_pool
from motord.batch.dask_pool import DaskPool
from motord.batch.error import WorkerDiedError

pytestmark = [
    pytest.mark.system,
    pytest.mark.slow,
    # of a worker that died in the handshake Dask leaves the socket to the garbage collector
    pytest.mark.filterwarnings("ignore:unclosed <ssl.SSLSocket:ResourceWarning"),
]

ROUNDS = 25
"""One in 13 had a result that Dask's own executor took for an error."""
WORKERS, QUICK = 2, 6


def die(after_s: float) -> None:
    time.sleep(after_s)
    os.kill(os.getpid(), signal.SIGKILL)


def quick(number: int) -> tuple[str, int]:
    return "result", number


def test_no_result_is_another_because_its_worker_died_afterwards() -> None:
    draw = random.Random(1)
    outcomes = Counter[str]()
    with DaskPool(WORKERS, None, pytest.fail) as pool:
        pool.window()
        for _ in range(ROUNDS):
            futures = [pool.submit(die, draw.uniform(0.0, 0.01))]
            futures += [pool.submit(quick, number) for number in range(QUICK)]
            while wait(futures, timeout=1.0).not_done:
                pool.window()
            for number, future in enumerate(futures, start=-1):
                try:
                    assert pool.result(future) == ("result", number)
                except WorkerDiedError:
                    outcomes["died"] += 1
                else:
                    outcomes["result"] += 1
    assert outcomes.total() == ROUNDS * (1 + QUICK)
    assert outcomes["died"] >= ROUNDS
    assert outcomes["result"] >= ROUNDS


def test_a_worker_that_dask_has_given_up_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(dask_pool.CONFIG, "distributed.deploy.lost-worker-timeout", "100ms")
    with DaskPool(1, None, pytest.fail) as pool:
        pool.window()
        cluster = pool._client.cluster
        [nanny] = cluster.workers.values()
        cluster.sync(nanny.close)
        future = pool.submit(quick, 0)
        while wait([future], timeout=0.1).not_done:
            pool.window()
        assert pool.result(future) == ("result", 0)


def test_what_workers_are_set_to_ends_with_the_pool() -> None:
    import dask
    import distributed  # noqa: F401  # has these settings; 0.4 s, of whoever collects

    before = dict(dask.config.get("distributed.comm.timeouts"))
    with DaskPool(1, None, pytest.fail) as pool:
        pool.window()
        for key, value in dask_pool.CONFIG_AT_WORK.items():
            assert dask.config.get(key) == value
    assert dask.config.get("distributed.comm.timeouts") == before
