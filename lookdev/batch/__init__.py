"""Running it: what is prepared, rendered in a worker process, written, retried, resumed and reported.

- `prepare`: a job file becomes scenes and a plan
- `run`: a plan becomes frames on disk; `worker` supervises the render process that makes them
- `pictures`: PNG and contact sheets, made from the frames
- `events`, `progress`: what happened, and how a person sees it
- `doctor`: whether this machine can do all that

The modules are imported where they are used: the command line answers ``--help`` without loading any of them.
"""
