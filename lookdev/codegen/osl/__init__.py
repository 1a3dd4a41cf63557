"""Write looks, lights and tables of points as OSL shaders, for backend ``exact`` in Cycles."""
