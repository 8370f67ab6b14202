"""Ads onto their tracked surfaces, frame by frame."""
