"""Jobs of searches, ramps and studies, in local processes or on a cluster."""

from expdesign.workers.ahead import Known, Procedure, foresee_nothing, unknown_jobs
from expdesign.workers.cluster import ClusterError, JobJournal, JobRunner, cluster_jobs
from expdesign.workers.job import Job, Monitor, StoppedError
from expdesign.workers.local import WorkerDiedError, prepare_workers, run_in_copies, run_jobs

__all__ = [
    "ClusterError",
    "Job",
    "JobJournal",
    "JobRunner",
    "Known",
    "Monitor",
    "Procedure",
    "StoppedError",
    "WorkerDiedError",
    "cluster_jobs",
    "foresee_nothing",
    "prepare_workers",
    "run_in_copies",
    "run_jobs",
    "unknown_jobs",
]
