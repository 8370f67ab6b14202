"""Training of HDN's components, each by itself, on samples of its own; resumable and seeded. See docs/training.md."""
