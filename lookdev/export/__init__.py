"""What a job becomes for other programs: a .blend, scenes of Mitsuba, a job of a farm; copies of the example jobs."""
