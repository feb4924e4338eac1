"""The process that reads the slow channels, and the supervisor's end of it."""
