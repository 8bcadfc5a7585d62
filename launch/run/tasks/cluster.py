"""A Dask cluster as an executor: the client of a running scheduler."""

import contextlib
import ipaddress
import logging
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from palpate.launch.run.tasks.local import cores, local
from palpate.launch.run.tasks.spread import Executor
from palpate.physics.errors import ArgumentError, RunError
from palpate.physics.extras import require_extra

ANSWERS = 10.0  # [s] Timeout of the connection
HELP = "see docs/scale.md"
CERTIFICATES = (
    "distributed.comm.tls.ca-file, .client.cert and .client.key in ~/.config/dask/distributed.yaml, or "
    "DASK_DISTRIBUTED__COMM__TLS__CA_FILE, ...__CLIENT__CERT and ...__CLIENT__KEY"
)


def cluster_or_local(
    scheduler: str | None, workers: int | None, log: Path, report: Callable[[str], None]
) -> contextlib.AbstractContextManager[Executor]:
    """Connect to the cluster of this scheduler; without a scheduler, use processes of this machine. Arguments as for
    `cluster` and `local`."""
    if scheduler is None:
        return local(workers or cores(), log)
    if workers is not None:
        raise ArgumentError("--workers: found a number and --scheduler, expected one of them")
    return cluster(scheduler, report)


@contextlib.contextmanager
def cluster(address: str, report: Callable[[str], None] = lambda text: None) -> Iterator[Any]:
    """A `dask.distributed.Client` of the scheduler at an address such as tls://host:8786, with the certificates of
    Dask's configuration.

    Tasks and results are pickled. A program that can reach a scheduler without TLS can therefore run code as its user:
    its address is refused unless only this machine can reach it, and then `report` gets a line.

    ArgumentError: the address is refused, or `distributed` is missing. RunError: no scheduler answers.
    """
    with require_extra("--scheduler", "cluster", ArgumentError):
        from distributed import Client, Security
    protocol, _, place = address.rpartition("://")
    if protocol not in ("tls", "tcp", "") or not place.rpartition(":")[2].isdecimal():
        raise ArgumentError(f"--scheduler {address}: expected tls://HOST:PORT, such as tls://cluster.lab:8786; {HELP}")
    if protocol != "tls":
        if not _loopback(place.rpartition(":")[0]):
            raise ArgumentError(
                f"--scheduler {address}: without TLS everybody on the network can run code on its workers and on this "
                f"machine; expected tls://{place}, with a scheduler that has certificates; {HELP}"
            )
        report(f"--scheduler {address}: without TLS, other users of this machine can run code on it; {HELP}")
    for name in ("distributed.client", "distributed.core", "distributed.comm"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # their errors are raised
    try:
        if protocol == "tls" and Security().get_connection_args("client")["ssl_context"] is None:
            raise OSError(f"Dask's configuration has no certificates for TLS: {CERTIFICATES}")
        with warnings.catch_warnings():  # about other versions, which the workers check
            warnings.simplefilter("ignore")
            client = Client(address, timeout=ANSWERS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise RunError(f"--scheduler {address}: {' '.join(str(error).split())}; {HELP}") from None
    with client:
        yield client


def _loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False
