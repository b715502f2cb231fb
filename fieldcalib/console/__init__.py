"""Common parts of all command-line programs: argument types, options, exit codes, progress, interrupts."""
