"""The command `lookdev validate`: lists all faults of the looks of a file, and elements without effect."""
