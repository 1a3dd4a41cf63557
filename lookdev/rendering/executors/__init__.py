"""Executors, which render the frames of a run on this machine or on others; the frames are the same, bit for bit."""
