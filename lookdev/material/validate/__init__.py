"""`lookdev validate`: all faults of the looks of a file, and notes on elements without effect."""
