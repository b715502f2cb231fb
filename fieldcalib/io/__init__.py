"""Files of others, one module a format. Foreign conventions end here."""
