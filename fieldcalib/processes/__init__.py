"""Work in other processes: a Python process that runs functions, an executor of several, and results in order."""
