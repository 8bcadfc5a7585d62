"""What every way of running shares: the plan, the jobs, the step of a node, the clocks, what is counted."""

import palpate.physics  # noqa: F401  pins the arithmetic, before numpy
