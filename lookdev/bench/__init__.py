"""`lookdev bench`: time against error, measured so that nobody can argue with it.

- `matrix`: scenes, lights, looks and backends, and what of them is asked for; `looks`, `assets` make them
- `backends`: what renders a cell of the matrix, each in a warm process of its own; `mitsuba_worker` is one of those
- `reference`: the converged picture of a backend, with its own error known, and the error of renders against it
- `measure`: which backend renders when, and what is measured of a render
- `curves`: time to an error, read off a measured curve
- `sequence`: turntables through the batch runner against a plain Blender script; `growth`: how cost grows
- `results`, `report`: all that was measured, as files, a table and plots; `run` does everything in order
"""
