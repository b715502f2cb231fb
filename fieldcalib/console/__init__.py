"""What all command-line programs share: argument types, options, exit codes, progress, interrupts."""
