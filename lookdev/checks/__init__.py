"""Does it agree: error measures, and models evaluated at points."""
