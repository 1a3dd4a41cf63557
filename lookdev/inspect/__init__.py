"""Describes assets, rigs, preset libraries and this machine, for the commands `inspect`, `materials` and `doctor`."""
