"""The classic models of reflection, as published: one file for each model or family of models."""
