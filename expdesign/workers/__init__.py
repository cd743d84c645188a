"""Jobs of searches, ramps and studies, in local processes or on a cluster."""

from expdesign.workers.cluster import ClusterError, JobJournal, JobRunner, cluster_jobs
from expdesign.workers.job import Job, Monitor, StoppedError
from expdesign.workers.local import WorkerDiedError, prepare_workers, run_in_copies, run_jobs

__all__ = [
    "ClusterError",
    "Job",
    "JobJournal",
    "JobRunner",
    "Monitor",
    "StoppedError",
    "WorkerDiedError",
    "cluster_jobs",
    "prepare_workers",
    "run_in_copies",
    "run_jobs",
]
