"""Write looks as shader nodes of Blender: traces of the models become instances of `NodeTree`, which are plain data."""
