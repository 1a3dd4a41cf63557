"""Who renders: tasks and answers as plain data, and the worker that is supervised."""
