"""Who renders: the registry of backends, tasks and answers as plain data, and supervised workers."""
