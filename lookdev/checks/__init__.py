"""Does it agree: error measures, models evaluated at points, and what `lookdev check` finds."""
