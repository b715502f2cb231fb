"""Files: foreign formats, one module each, where foreign conventions end; and writing whole or not at all."""
