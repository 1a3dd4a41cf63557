"""`lookdev bench`: time against error, beside other renderers.

- `kinds`: the kinds of benchmark, a record each; `run` does everything of one in order
- `matrix`: scenes, lights, looks and backends, and a choice of them; `looks`, `assets`, `rigs` make them
- `backends`: the renderers of a cell of the matrix, each a warm process; `mitsuba_worker` is one of them
- `reference`: the converged picture of a backend, with its own error, and the error of renders against it
- `measure`: the schedule of renders, raw and denoised, and the measurements of each
- `curves`: time to an error, by a measured curve
- `denoise_trial`: denoised frames at random, and their errors
- `growth`: cost over size; `profile`: where a second goes
- `sequence`: turntables by the batch runner against a plain Blender script
- `scale`: large assets up to the first sample; `scale_files` writes them, `scale_job` is a job in a fresh process
- `results`, `report`, `plots`: all measurements as files, tables on the terminal, SVGs
- `table`, `document`: as a section of a document
"""
