"""Rendering: the registry of backends, tasks and answers as plain data, and the supervision of workers."""
