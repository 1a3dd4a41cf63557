"""From a model to shader code: symbolic arrays trace the model, emitters write the code."""
