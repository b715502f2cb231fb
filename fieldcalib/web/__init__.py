"""The page that shows, mends and labels frames: its server, and reports of one file."""
