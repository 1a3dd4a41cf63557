"""A Job becomes Scenes: expand, read, assign, refine, frame, each a step from values to values that collects faults."""
