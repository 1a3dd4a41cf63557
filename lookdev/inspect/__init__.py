"""Descriptions of assets, rigs, preset libraries and this machine."""
