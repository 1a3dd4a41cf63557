"""`lookdev bench`: time against error, compared with other renderers.

- `kinds`: the registry of benchmarks; `benchmark`: what they share, from options to files, sections and reports
- `options`: what is measured; `subjects`: assets, looks and lights, and their scenes
- `matrix`: time against error of cells, which are a scene, a light and a look; and the table of a document;
  `mitsuba_worker` is one of its backends
- `sequence`: turntables by the batch runner against a plain Blender script, at the same error
- `reference`: the converged picture of a backend, with its own error, and the error of renders against it
- `measure`: the renders of a cell, the measurements of each, and times to an error by curves
- `growth`: cost over size; `report`: tables and plots
- `profile`, `setup`, `scale`, `denoise_trial`: the other benchmarks; `scale_job` is a job in a fresh process
"""
