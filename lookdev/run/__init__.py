"""Runs of a job, on one machine or many: claims, resumed frames, chunks, status, progress, and files made of frames.

Other packages import these modules in their functions, so that ``lookdev --help`` loads none of them.
"""
