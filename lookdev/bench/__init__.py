"""`lookdev bench`: measures the time that renders take to an error, and compares it with other renderers.

A cell is one scene, one light and one look that are rendered together.

- `kinds`: the registry of benchmarks
- `benchmark`: the base class of all benchmarks: a run, its files, its section of a document and its report
- `options`: the choice of scenes, lights, looks, backends and numbers of samples
- `subjects`: the assets, looks and lights that can be rendered, and their scenes
- `matrix`: the benchmark of time against error for many cells, and the table in docs/bench.md
- `mitsuba_worker`: the worker of the backend `mitsuba-principled`
- `sequence`: the benchmark of turntables, by the batch runner and by a plain Blender script, at the same error
- `reference`: the converged picture of a backend, the error of this picture, and the error of renders against it
- `measure`: renders a cell, measures each render, and reads times to an error from curves
- `growth`: the cost of a frame over the size of a scene
- `report`: tables and plots
- `profile`, `setup`, `scale`, `denoise_trial`: the other benchmarks
- `scale_job`: the process that `scale` starts to run a job up to its first sample
"""
