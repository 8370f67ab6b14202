"""Frames and plain geometry, with NumPy and OpenCV alone."""
