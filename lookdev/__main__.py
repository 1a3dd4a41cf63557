"""``python -m lookdev``: the command line."""

from lookdev.cli import main

if __name__ == "__main__":  # processes of multiprocessing import this module too
    main()
