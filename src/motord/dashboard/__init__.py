"""The live page: a client of the daemon that serves a browser (`motord dashboard`)."""
