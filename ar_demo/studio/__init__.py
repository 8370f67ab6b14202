"""Studio: a page on this machine to pick surfaces, track, check, mend and render; see `command`."""
