"""A study on a cluster: its workers are jobs of a batch system, and all connections have TLS.

    python docs/examples/cluster.py mine.yaml -o results --jobs 4 --system slurm

Needs `pip install "palpate[study,cluster]" dask-jobqueue` in an environment that all machines share, and a folder that
they share for the certificates and the study. `--system local` runs the jobs as processes of this machine. A job that
ends early, for example at its time limit, is replaced. Start the same command again after it was interrupted: it
computes what is missing.
"""

import argparse
import logging
import signal
import sys
from pathlib import Path

from palpate.physics.errors import PalpateError
from palpate.studies.sweeps.file import find, load


def cluster(given: argparse.Namespace):
    """The scheduler, which runs in this process, and the jobs with the workers."""
    if given.system == "slurm":
        from dask_jobqueue import SLURMCluster as Cluster
    else:
        from dask_jobqueue.local import LocalCluster as Cluster
    for number in (signal.SIGINT, signal.SIGTERM):  # dask_jobqueue would end this process with exit code 0
        signal.signal(number, lambda number, frame: sys.exit(128 + number))
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # the study reports what is lost
    shared = Path(given.out, "certificates").absolute()
    shared.mkdir(mode=0o700, parents=True, exist_ok=True)
    logs = Path(given.out, "jobs").absolute()
    return Cluster(
        cores=given.cores,
        processes=given.cores,  # one worker for each core: a point is computed in one thread
        memory=f"{given.cores} GB",
        walltime=given.time,
        log_directory=str(logs),  # what each job printed
        security=True,  # a new authority and certificate for this run
        shared_temp_directory=str(shared),
        n_workers=given.jobs * given.cores,
        # Dask's pages about scheduler and workers have no TLS: only the machine itself can read them.
        scheduler_options={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
        worker_extra_args=["--no-dashboard", "--dashboard-address", "127.0.0.1:0"],
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", help="file of a study, or name of a shipped one")
    parser.add_argument("-o", "--out", default="results", help="folder of the results, which all machines share")
    parser.add_argument("--system", choices=["slurm", "local"], default="slurm")
    parser.add_argument("--jobs", type=int, default=4)
    parser.add_argument("--cores", type=int, default=1, help="of a job")
    parser.add_argument("--time", default="01:00:00", help="limit of a job")
    given = parser.parse_args()
    try:
        study = load(find(given.study))
        with cluster(given) as jobs, jobs.get_client() as client:
            jobs.adapt(minimum_jobs=given.jobs, maximum_jobs=given.jobs, interval="20 s")  # replaces jobs that ended
            study.run(given.out, client, report=lambda text: print(text, file=sys.stderr))
    except PalpateError as error:
        sys.exit(f"{error}; the same command continues")
    except SystemExit:  # after the jobs are cancelled
        print("interrupted: finished points are stored, and the same command continues", file=sys.stderr)
        raise
    print(study.table())


if __name__ == "__main__":
    main()
