"""Tracks of other programs, read for use here."""
