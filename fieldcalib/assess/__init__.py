"""What a solved problem says: uncertainty, probability, the paper's losses, the verdict, the result."""
