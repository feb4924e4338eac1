"""The estimator of a plan, in a process of its own while the plan runs."""
