"""From a Job to its Scenes, in steps: expand, read, assign, refine, frame. Each step collects faults."""
