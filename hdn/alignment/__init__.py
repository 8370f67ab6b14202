"""Photometric alignment of the rectified target to the template, and how well it agrees."""
