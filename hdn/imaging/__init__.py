"""Frames and plain geometry, with NumPy and OpenCV alone; anything may use it.

- `arrays`: the types of arrays that pass between modules
- `homography`, `quads`: plane geometry
- `regions`: where a tracker may look
- `pyramid`, `observation`: frames, and crops and keypoints of them
- `photometry`, `blur`: comparing images whatever the light and the blur
"""
