"""What people look at: pictures of a recording, and the pages in the browser."""

import palpate.physics  # noqa: F401  pins the arithmetic, before numpy
