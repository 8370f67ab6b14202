"""Where and when a video shows given pictures."""
