"""The moving average over the last N samples of a position, the filter of the kidney study, in place of the observer.

The position is the mean of the last N readings, and the velocity the mean of the last N backward differences,

    x = (1/N) Σ r_{k-i},  i = 0 ... N-1,      v = (1/N) Σ (r_{k-i} - r_{k-i-1})/T = (r_k - r_{k-N})/(t_k - t_{k-N})

with the time stamps t, so an uneven clock adds no error. With the sampling rate f_s, position and velocity have the
gain |H| and lag behind the motion:

    |H| = |sin(N π f/f_s)/(N sin(π f/f_s))|,     delay of x: (N-1)/2 samples,     delay of v: N/2 samples

For N = 8 the gain is -3 dB at 0.446 f_s/8 = 57 Hz at 1025 Hz; the first null is at f_s/8. (The study gives 110 to
160 Hz as the -3 dB frequency at 878 to 1265 Hz: these are the nulls.) The resolution of the velocity is q/(N T): a
count q of 60 um at 1025 Hz is 61.5 mm/s without a filter and 7.7 mm/s with N = 8. White noise of the position falls by
sqrt(N), and that of the velocity by N.

Source: the kidney study (a soft fingertip on a kidney, Falcon), which chose eight points by trial; S. W. Smith, "The
Scientist and Engineer's Guide to Digital Signal Processing" (1997), chapter 15, for the gain.
"""

from palpate.compiler.fields import element_type
from palpate.compiler.kernel import kernel
from palpate.compiler.records import put
from palpate.physics.arrays import Record, Vector3

PUBLISHED = 8  # points
MOST = 64
READINGS = element_type({"place": (3,), "moment": ()})
"""A reading [m], and its time [s]."""


@kernel
def add(window: Record, state: Record, restart: bool, time: float, reading: Vector3):
    """Add a reading, and compute the averages: (x, y, z, vx, vy, vz) [m], [m/s].

    window   (N+1)    `READINGS`, a ring
    state             `count` of readings in the window and the row `at` of the newest one, changed in place
    restart           forget the earlier readings: the position has jumped, and the velocity is 0
    time     [s]      of the reading [m] (3)
    """
    size = len(window)
    if restart:
        state.count = 0
    state.at = (state.at + 1) % size
    state.count = min(state.count + 1, size)
    put(window[state.at].place, reading)
    window[state.at].moment = time
    last = min(state.count, size - 1)  # readings of the mean
    x = y = z = 0.0
    for i in range(last):
        place = window[(state.at - i) % size].place
        x, y, z = x + place[0], y + place[1], z + place[2]
    first = window[(state.at - state.count + 1) % size]
    span = time - first.moment
    scale = 1.0 / span if span > 0.0 else 0.0
    return (
        x / last, y / last, z / last, scale * (reading[0] - first.place[0]), scale * (reading[1] - first.place[1]),
        scale * (reading[2] - first.place[2]),
    )  # fmt: skip
