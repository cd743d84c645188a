"""Jobs on local processes or on a cluster: what a search, ramps and studies are worked off with."""

from expdesign.workers.cluster import ClusterError, cluster_jobs
from expdesign.workers.job import Job, Monitor, StoppedError
from expdesign.workers.local import WorkerDiedError, run_jobs

__all__ = [
    "ClusterError",
    "Job",
    "Monitor",
    "StoppedError",
    "WorkerDiedError",
    "cluster_jobs",
    "run_jobs",
]
