"""motord: real-time motor controller and data-acquisition daemon for a motor test bench."""
