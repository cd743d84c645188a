"""Jobs of searches, ramps and studies, in local processes or on a cluster."""

from expdesign.workers.ahead import Known as Known
from expdesign.workers.ahead import Procedure as Procedure
from expdesign.workers.ahead import foresee_nothing as foresee_nothing
from expdesign.workers.ahead import unknown_jobs as unknown_jobs
from expdesign.workers.cluster import ClusterError as ClusterError
from expdesign.workers.cluster import JobJournal as JobJournal
from expdesign.workers.cluster import JobRunner as JobRunner
from expdesign.workers.cluster import cluster_jobs as cluster_jobs
from expdesign.workers.job import Job as Job
from expdesign.workers.job import Monitor as Monitor
from expdesign.workers.job import StoppedError as StoppedError
from expdesign.workers.local import WorkerDiedError as WorkerDiedError
from expdesign.workers.local import prepare_workers as prepare_workers
from expdesign.workers.local import run_in_copies as run_in_copies
from expdesign.workers.local import run_jobs as run_jobs
