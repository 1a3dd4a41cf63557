"""``python -m lookdev``: the command line."""

from lookdev.cli import main

main()
