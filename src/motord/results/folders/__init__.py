"""Where a results store is: a local folder, or one behind a URL."""
