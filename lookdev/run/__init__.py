"""Runs of a job, by one process or by many on several machines.

The modules divide a job into chunks, claim frames, resume runs, report progress and status, and make files of finished
frames. Other packages import these modules in their functions, so that ``lookdev --help`` loads none of them.
"""
