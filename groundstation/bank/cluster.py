"""Dask's workers: processes of this machine, or those of a scheduler that runs already (extra ``cluster``)."""

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from groundstation.errors import InputError, MissingExtraError, os_words

if TYPE_CHECKING:
    from distributed import Client

_CONNECT_S = 30.0
# Dask drops a local worker that is absent for 15 s; on a busy machine a new process takes longer than that
_LOCAL_CONFIG = {"distributed.deploy.lost-worker-timeout": "1 hour"}
_ANY_PORT = "127.0.0.1:0"


def usable_cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def require_dask() -> None:
    """Raise `MissingExtraError` unless Dask's workers can be had."""
    try:
        import distributed  # noqa: F401 - only whether it is there
    except ModuleNotFoundError as error:
        raise MissingExtraError("running on many workers", "cluster") from error


@contextmanager
def open_cluster(workers: int, scheduler: str | None) -> "Iterator[Client]":
    """Connect to a scheduler, or start ``workers`` processes of one thread on this machine and end them.

    Raises `MissingExtraError` without Dask, `InputError` where no scheduler answers.
    """
    require_dask()
    import dask
    from distributed import Client, LocalCluster

    # a worker that dies is reported by the caller, with the job that it had
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as fault:
            said = os_words(fault) if os_words(fault) else type(fault).__name__
            raise InputError("--scheduler", got=f"{scheduler}: {said}", wanted="a Dask scheduler's address") from fault
        with client:
            yield client
        return
    with (
        _same_environment(),
        dask.config.set(_LOCAL_CONFIG),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=_ANY_PORT,
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster, timeout=_CONNECT_S, set_as_default=False) as client,
    ):
        yield client


@contextmanager
def _same_environment() -> Iterator[None]:
    """Restore the environment variables: Dask sets some for its workers in this process, also the allocator's."""
    before = dict(os.environ)
    try:
        yield
    finally:
        for name in os.environ.keys() - before.keys():
            del os.environ[name]
        os.environ.update(before)
