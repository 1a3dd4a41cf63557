"""The job file: its schema, and a strict reader that reports every fault at once. `lookdev.build` makes its scenes."""

from lookdev.job.load import json_schema, load_job, parse_job
from lookdev.job.outputs import JobOutputs
from lookdev.job.schema import Job, JobTurntable

__all__ = ["Job", "JobOutputs", "JobTurntable", "json_schema", "load_job", "parse_job"]
