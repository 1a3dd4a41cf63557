"""The classic models of reflection, as published: one file a model, or a family of models."""
