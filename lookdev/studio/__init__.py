"""The web page: a scene in real time in the browser, and what edits it."""
