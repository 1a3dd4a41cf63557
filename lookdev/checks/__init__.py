"""Does it agree: models and looks compared with the reference, at points, as albedos, images and under stress."""
