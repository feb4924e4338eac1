"""CSV as a source of rows."""
