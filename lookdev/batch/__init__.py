"""Running jobs: preparation, resuming, retries, progress, outputs; checks, export, examples, crash reports.

Modules are imported where they are used, so that ``lookdev --help`` loads none of them.
"""
