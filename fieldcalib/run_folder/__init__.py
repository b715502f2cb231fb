"""Runs over many frames: reading their files, working on them in units, writing and resuming the folder of results."""
