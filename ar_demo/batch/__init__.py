"""Many jobs, each a process of its own: what `ar-batch` does."""
