"""What the user asked: a job file, read strictly, with every fault reported at once; `scenes` makes scenes of it."""

from lookdev.job.load import json_schema, load_job, parse_job
from lookdev.job.outputs import JobOutputs
from lookdev.job.schema import Job, JobTurntable

__all__ = ["Job", "JobOutputs", "JobTurntable", "json_schema", "load_job", "parse_job"]
