"""Building the scenes of a job from its files; `scenes.build_scenes` is the entry, and lists the steps."""
