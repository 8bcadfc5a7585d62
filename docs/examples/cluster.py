"""A study on a cluster: its workers are jobs of a batch system, and all connections have TLS.

    python docs/examples/cluster.py mine.yaml -o results --jobs 4 --system slurm

Needs `pip install "palpate[study,cluster]" dask-jobqueue` in an environment that all machines share, and a folder that
they share for the certificates and the study. `--system local` runs the jobs as processes of this machine. Start the
same command again after it was interrupted: it computes what is missing.
"""

import argparse
from pathlib import Path

from palpate.studies.sweeps.file import find, load


def cluster(given: argparse.Namespace):
    """The scheduler, which runs in this process, and the jobs with the workers."""
    if given.system == "slurm":
        from dask_jobqueue import SLURMCluster as Cluster
    else:
        from dask_jobqueue.local import LocalCluster as Cluster
    shared = Path(given.out, "certificates").absolute()
    shared.mkdir(mode=0o700, parents=True, exist_ok=True)
    return Cluster(
        cores=given.cores,
        processes=given.cores,  # one worker for each core: a point is computed in one thread
        memory=f"{given.cores} GB",
        walltime=given.time,
        security=True,  # a new authority and certificate for this run
        shared_temp_directory=str(shared),
        n_workers=given.jobs * given.cores,
        scheduler_options={"dashboard": False},
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
    study = load(find(given.study))
    with cluster(given) as jobs, jobs.get_client() as client:
        study.run(given.out, client, report=print)
    print(study.table())


if __name__ == "__main__":
    main()
