"""Training of HDN's two components, each on samples of its own; resumable and seeded. See docs/training.md."""

from .cli import main

__all__ = ["main"]
