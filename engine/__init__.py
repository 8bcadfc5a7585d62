"""What every way of running shares: the plan, the jobs, the step of a node, the clocks, what is counted."""
