"""What a user gets: float EXR frames, display PNGs and contact sheets."""

from lookdev.output.display import composite, to_display, write_png
from lookdev.output.exr import read_frame, read_header, write_frame
from lookdev.output.sheet import write_sheet

__all__ = ["composite", "read_frame", "read_header", "to_display", "write_frame", "write_png", "write_sheet"]
