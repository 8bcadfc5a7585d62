"""Workers of a study on other machines: a scheduler of Dask that runs already, or jobs of SLURM.

Dask computes what anybody sends who reaches a scheduler or a worker, so jobs of SLURM talk by TLS: one certificate per
study, whose key lies in a folder that only this user may open, is asked for at each end of each connection.
"""

import contextlib
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

from palpate.physics.errors import ArgumentError, RunError
from palpate.physics.extras import missing
from palpate.studies.sweeps.batches import Pool

try:
    import dask.config
    import distributed
except ImportError as error:
    raise RunError(missing("studies on other machines", error.name, "study")) from None

CONNECTS = 10.0  # [s] in which a scheduler answers
ENCRYPTED = ("tls://", "wss://", "inproc://")  # How addresses begin that strangers cannot send work to


@contextlib.contextmanager
def pool(client: distributed.Client) -> Iterator[Pool]:
    """The workers of a client. RunError: the scheduler is lost."""
    try:
        executor = client.get_executor(pure=False)
        yield Pool(executor, lambda: sum(client.nthreads().values()), (distributed.KilledWorker,))
    except (OSError, CancelledError) as error:
        address = client.scheduler.addr if client.scheduler else "the scheduler"
        raise RunError(
            f"{address}: the scheduler is lost. What was computed before is stored; run the study again to go on"
        ) from error


def exposed(client: distributed.Client) -> str:
    """A warning where strangers can send work to the scheduler of a client; else empty."""
    address = str(getattr(client.scheduler, "addr", ""))
    if address.startswith(ENCRYPTED):
        return ""
    return (
        f"{address} is not encrypted and asks nobody for a key: whoever reaches this port, any user of the machine "
        "included, can run programs as the user of the workers. Start the scheduler and its workers with "
        "--tls-ca-file, --tls-cert and --tls-key, and give its tls:// address"
    )


def connect(address: str) -> distributed.Client:
    """A client of a scheduler. RunError: there is none."""
    try:
        return distributed.Client(address, timeout=CONNECTS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise RunError(f"no scheduler of Dask at {address}: {' '.join(str(error).split())}") from None


@contextlib.contextmanager
def slurm(options: Mapping[str, Any], folder: Path) -> Iterator[Any]:
    """A cluster of SLURM, no job submitted yet: the keywords of `dask_jobqueue.SLURMCluster` but for the processes, as
    each core is a worker. ArgumentError: one that it does not take.

    folder  that all machines see; the key lies below it in a folder of mode 0700 until the cluster is closed
    """
    try:
        import cryptography  # noqa: F401 - Dask makes certificates with it
        from dask_jobqueue import SLURMCluster
    except ImportError as error:
        raise RunError(missing("SLURM", error.name, "study")) from None
    folder.mkdir(parents=True, exist_ok=True)
    with (
        tempfile.TemporaryDirectory(prefix=".keys-", dir=folder.absolute(), ignore_cleanup_errors=True) as keys,
        dask.config.set({"distributed.scheduler.http.routes": []}),  # HTTP asks nobody for a key: it serves nothing
    ):
        given = {"cores": 1, "memory": "2 GB", "security": _security(Path(keys)), **options}
        given.pop("jobs", None)
        given["scheduler_options"] = {"dashboard": False, "dashboard_address": "127.0.0.1:0"} | dict(
            given.get("scheduler_options", {})
        )
        routes = "export DASK_DISTRIBUTED__WORKER__HTTP__ROUTES='[]'"
        given["job_script_prologue"] = [routes, *given.get("job_script_prologue", ())]
        served = ["--no-dashboard", "--dashboard-address", "127.0.0.1:0"]
        given["worker_extra_args"] = [*served, *given.get("worker_extra_args", ())]
        try:
            cluster = SLURMCluster(**given | {"processes": given["cores"]})
        except (TypeError, ValueError) as error:
            raise ArgumentError(f"slurm: {error}") from None
        with cluster:
            yield cluster


def _security(folder: Path) -> distributed.Security:
    """TLS by a new certificate, for both ends of each connection; it and its key are written to a folder."""
    made = distributed.Security.temporary()
    files = {"cert": folder / "certificate.pem", "key": folder / "key.pem"}
    files["cert"].write_text(made.tls_ca_file)
    files["key"].write_text(made.tls_client_key)
    roles = {
        f"tls_{role}_{what}": str(file) for role in ("client", "scheduler", "worker") for what, file in files.items()
    }
    return distributed.Security(require_encryption=True, tls_ca_file=str(files["cert"]), **roles)


@contextlib.contextmanager
def submitted(options: Mapping[str, Any], folder: Path) -> Iterator[distributed.Client]:
    """A client of a cluster of SLURM whose jobs are in the queue. RunError: this machine has no SLURM."""
    if shutil.which("sbatch") is None:
        raise RunError("no `sbatch` here: run this on a login node of the cluster, or see the script with --job-script")
    with slurm(options, folder) as cluster:
        cluster.scale(jobs=options.get("jobs", 1))
        with distributed.Client(cluster, set_as_default=False) as client:
            yield client
