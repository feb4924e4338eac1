"""`motord calibration`: show, list, install, adopt, and export for a drive."""
