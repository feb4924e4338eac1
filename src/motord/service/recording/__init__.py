"""What the supervisor has recorded: the recorder's session, runs and plans, timing."""
