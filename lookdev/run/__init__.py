"""Jobs on this machine and many: runs and their claims, resumed frames, chunks, status, progress, files made of frames.

Modules are imported where they are used, so that ``lookdev --help`` loads none of them.
"""
