"""Shared by runs, replays and tests: the plan, the jobs, the step of a node, the clocks, the counters."""
