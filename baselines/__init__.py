"""Other methods behind the interface of fieldcalib. They import fieldcalib, never the reverse."""
