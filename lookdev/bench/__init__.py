"""`lookdev bench`: time against error, beside other renderers.

- `matrix`: scenes, lights, looks and backends, and a choice of them; `looks`, `assets` make them
- `backends`: the renderers of a cell of the matrix, each a warm process; `mitsuba_worker` is one of them
- `reference`: the converged picture of a backend, with its own error, and the error of renders against it
- `measure`: the schedule of renders, and the measurements of each
- `curves`: time to an error, by a measured curve
- `sequence`: turntables by the batch runner against a plain Blender script; `growth`: cost over size
- `scale`: large assets up to the first sample; `scale_files` writes them, `scale_job` is a job in a fresh process
- `results`, `report`: all measurements as files, a table and plots; `run` does everything in order
"""
