"""Results of analyses as rows of one table: kept in a folder, queried, charted and compared."""
