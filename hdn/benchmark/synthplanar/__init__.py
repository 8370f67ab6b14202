"""SynthPlanar: drawn clips of a textured plane whose corners are known exactly."""
