"""Tools that make and convert data. They import fieldcalib, never the reverse."""
