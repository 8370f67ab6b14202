"""`ar-eval`: how good composites are."""
