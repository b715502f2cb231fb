"""The fields of other sports than soccer, from their rule books."""
