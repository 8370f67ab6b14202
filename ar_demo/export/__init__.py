"""The track for other programs: one file for each format, and a registry that takes others' as well."""
