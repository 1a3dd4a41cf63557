"""What the user asked: a job file, read strictly, with every fault reported at once; `scenes` makes scenes of it."""

from lookdev.job.load import json_schema, load_job, parse_job
from lookdev.job.schema import Job, JobAsset, JobCamera, JobIbl, JobLook, JobOutputs, JobRender, JobTurntable

__all__ = [
    "Job",
    "JobAsset",
    "JobCamera",
    "JobIbl",
    "JobLook",
    "JobOutputs",
    "JobRender",
    "JobTurntable",
    "json_schema",
    "load_job",
    "parse_job",
]
