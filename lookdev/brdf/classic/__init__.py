"""The classic reflectance models, as published: one file for each model or family of models."""
