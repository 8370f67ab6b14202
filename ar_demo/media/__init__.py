"""Reading and writing: video, sound, ads, live streams."""
