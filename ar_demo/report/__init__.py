"""The report on a job: one HTML file that tells, without watching it all, whether a track can be believed."""
