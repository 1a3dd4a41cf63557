"""Checks that models and looks agree with the reference: at points, as albedos, as images, and in extreme cases."""
