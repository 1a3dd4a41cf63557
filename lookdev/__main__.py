"""The command line as a module: ``python -m lookdev`` does what the program ``lookdev`` does."""

from lookdev.cli import main

if __name__ == "__main__":  # processes of multiprocessing also import this module, under another name
    main()
