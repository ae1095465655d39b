"""Work on Dask distributed: a scheduler somewhere, or a cluster of this machine's own on the loopback interface.

A worker that is lost takes its pieces of work with it; the scheduler gives them to others. What comes back is the same
whoever did it, for workers must run the same versions of everything that numbers depend on.
"""

from __future__ import annotations

import logging
import os
import uuid
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

from polfuse_lab.errors import PolfuseError, first_line
from polfuse_lab.products.provenance import versions
from processing.errors import DataError

LOCAL = "local"
"""The address that means: processes of this machine, for this run only."""

CONNECT_S = 10.0
"""How long a scheduler may take to answer, and a first worker to come."""

PIECES_AHEAD = 2
"""Pieces of work that are given out for each worker beyond what it works on: results wait here, not in memory there."""

Work = Callable[..., Any]


@dataclass(frozen=True)
class Cluster:
    """A connection to a Dask scheduler. Made by :func:`connect`."""

    client: Any
    """The ``distributed.Client``."""
    address: str

    @property
    def worker_count(self) -> int:
        """Pieces of work that are done at the same time."""
        return max(int(sum(self.client.nthreads().values())), 1)

    def each(self, work: Work, arguments: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
        """Call ``work`` with each of the arguments on some worker; gives index and result as they come.

        Args:
            work: a function of a module that workers have.
            arguments: those of each call.

        Raises:
            PolfuseError: what the work raised; a piece that took several workers down; the scheduler is gone.
            DataError: what the work raised.
        """
        distributed = _distributed()
        run = uuid.uuid4().hex
        waiting = iter(enumerate(arguments))
        indices: dict[Any, int] = {}
        finished = distributed.as_completed(loop=self.client.loop)

        def give_out() -> None:
            for index, values in waiting:
                future = self.client.submit(_guarded, work, values, key=f"polfuse-{run}-{index}", pure=False, retries=0)
                indices[future] = index
                finished.add(future)
                return

        try:
            for _ in range(self.worker_count * PIECES_AHEAD):
                give_out()
            for future in finished:
                index = indices.pop(future)
                outcome = self._outcome(distributed, future)
                future.release()
                give_out()
                yield index, outcome
        finally:
            for future in indices:
                future.release()

    def _outcome(self, distributed: Any, future: Any) -> Any:
        try:
            good, value = future.result(timeout=CONNECT_S)
        except distributed.scheduler.KilledWorker as error:
            raise PolfuseError(
                f"one piece of work took {self._allowed(distributed)} workers down, one after the other",
                where=f"Dask at {self.address}",
                advice="look whether workers run out of memory (give --memory, or start them with more), and run the "
                "same command again, which goes on where it stopped",
            ) from error
        except (OSError, TimeoutError, distributed.comm.CommClosedError, _cancelled(distributed)) as error:
            raise PolfuseError(
                f"the scheduler does not answer any more ({type(error).__name__})",
                where=f"Dask at {self.address}",
                advice="start it again and run the same command, which goes on where it stopped",
            ) from error
        if good:
            return value
        kind, what, where, advice = value
        raise DataError(what, advice) if kind == "DataError" else PolfuseError(what, where=where, advice=advice)

    @staticmethod
    def _allowed(distributed: Any) -> int:
        import dask

        return int(dask.config.get("distributed.scheduler.allowed-failures", 3)) + 1


@contextmanager
def connect(address: str, *, workers: int | None = None) -> Iterator[Cluster]:
    """Connect to a Dask scheduler, or start one with workers for as long as this lasts.

    Args:
        address: such as ``tcp://10.0.0.5:8786``, or :data:`LOCAL`: processes of this machine that listen on the
            loopback interface only.
        workers: processes of a local cluster; one for each core where left out.

    Raises:
        PolfuseError: Dask is not installed, nobody answers there, no worker comes, or versions differ.
    """
    distributed = _distributed()
    with warnings.catch_warnings():
        # Different versions are told below, as an error; how Dask closes its event loop is nobody's business here.
        warnings.simplefilter("ignore")
        with _cluster(distributed, address, workers) as reached, _client(distributed, address, reached) as client:
            _check_workers(client, address)
            yield Cluster(client, address)


@contextmanager
def _cluster(distributed: Any, address: str, workers: int | None) -> Iterator[Any]:
    if address != LOCAL:
        yield address
        return
    count = os.cpu_count() or 1 if workers is None else workers
    if count < 1:
        raise PolfuseError(f"{count} workers do nothing", where="--dask local", advice="give at least one")
    with distributed.LocalCluster(
        n_workers=count,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        dashboard_address=None,
        silence_logs=logging.CRITICAL,
        memory_limit=0,
    ) as cluster:
        yield cluster


@contextmanager
def _client(distributed: Any, address: str, reached: Any) -> Iterator[Any]:
    try:
        client = distributed.Client(reached, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError, RuntimeError) as error:
        raise PolfuseError(
            f"no Dask scheduler answers there ({first_line(error)})",
            where=f"--dask {address}",
            advice="start one with 'dask scheduler', give its address like tcp://HOST:8786, or use --dask local",
        ) from error
    with client:
        yield client


def _check_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError as error:
        raise PolfuseError(
            "the scheduler has no workers",
            where=f"--dask {address}",
            advice="start some with 'dask worker ADDRESS' in an environment that has polfuse-lab",
        ) from error
    own = worker_versions()
    for name, answer in client.run(worker_versions, on_error="return").items():
        if not isinstance(answer, dict):
            raise PolfuseError(
                f"worker {name} cannot run polfuse-lab ({answer})",
                where=f"--dask {address}",
                advice="install polfuse-lab in the workers' environment",
            )
        if different := [key for key in sorted(own.keys() | answer.keys()) if own.get(key) != answer.get(key)]:
            told = ", ".join(
                f"{key} {answer.get(key, 'missing')} there, {own.get(key, 'missing')} here" for key in different
            )
            raise PolfuseError(
                f"worker {name} has other versions: {told}",
                where=f"--dask {address}",
                advice="install the same versions on both sides, else results could differ",
            )


def worker_versions() -> dict[str, str]:
    """Versions that a worker and its client must have in common."""
    return {**versions(), "distributed": version("distributed")}


def _guarded(work: Work, arguments: tuple[Any, ...]) -> tuple[bool, Any]:
    """On a worker: the result, or what went wrong in words (errors with keywords do not survive being sent)."""
    _limit_threads()
    try:
        return True, work(*arguments)
    except PolfuseError as error:
        return False, ("PolfuseError", error.what, error.where, error.advice)
    except DataError as error:
        return False, ("DataError", error.what, "", error.advice)


def _limit_threads() -> None:
    """As many threads as Dask gives the worker; results are the same with any number."""
    import numba
    from distributed import get_worker

    try:
        threads = int(get_worker().state.nthreads)
    except (ValueError, AttributeError):
        return
    config: Any = numba.config
    numba.set_num_threads(max(1, min(threads, config.NUMBA_NUM_THREADS)))


def _cancelled(distributed: Any) -> type[BaseException]:
    kind: type[BaseException] = distributed.CancelledError
    return kind


def _distributed() -> Any:
    try:
        import distributed
        import distributed.comm
        import distributed.scheduler
    except ImportError as error:
        raise PolfuseError(
            "Dask distributed is not installed",
            where="--dask",
            advice="install it with: pip install 'polfuse-lab[dask]'",
        ) from error
    return distributed
