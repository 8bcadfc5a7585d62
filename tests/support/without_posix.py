"""Runs a graph in one process without the modules and functions that exist only on POSIX."""

import importlib
import os
import signal
import socket
import sys
import tempfile

# Other packages, and the modules of the standard library that they load, are not affected.
for package in ("gymnasium", "matplotlib.pyplot", "numba", "numpy", "rich.console", "scipy.linalg", "zmq"):
    importlib.import_module(package)

MODULES = ("fcntl", "resource", "termios", "pwd", "grp", "pty", "tty", "readline", "syslog", "crypt")
FUNCTIONS = {
    os: """fork forkpty register_at_fork getuid geteuid getgid getpgid setpgid setsid killpg uname pipe2 waitid wait
        sched_getaffinity sched_setaffinity sched_setscheduler sched_param SCHED_RR getpriority mkfifo statvfs
        posix_spawn O_CLOEXEC O_NONBLOCK getloadavg nice""",
    signal: """SIGALRM SIGHUP SIGCHLD SIGUSR1 SIGUSR2 SIGSTOP SIGCONT SIGPIPE setitimer getitimer ITIMER_REAL
        alarm pthread_sigmask pthread_kill sigwait""",
    socket: "AF_UNIX SO_PEERCRED",
}
for name in MODULES:
    sys.modules[name] = None
for module, names in FUNCTIONS.items():
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)


def main():
    import numpy as np

    import palpate
    from palpate.gym.touch import Touch
    from palpate.models.fit.curve_fit import fit_curve
    from palpate.models.fit.tissue import fit  # noqa: F401
    from palpate.physics.contact.force_models import MODELS

    folder = tempfile.mkdtemp()
    run = palpate.run(sys.argv[1], record=f"{folder}/run.mcap", duration=0.12)
    again = palpate.open(run.path)
    assert again.contact.force.max() == run.contact.force.max() > 0.05
    assert sum(tick.contact.force > 0.0 for tick in palpate.steps(sys.argv[1], duration=0.12)) > 20
    env = Touch(sys.argv[1], duration=1.0)
    env.reset(seed=1)
    for _ in range(8):
        seen = env.step(np.array([0.0, 0.0, -0.03], np.float32))[0]
    assert np.isfinite(seen["force"]).all()
    env.close()
    fitted = fit_curve(MODELS["linear"], np.array([0.0, 1e-3, 2e-3, 3e-3]), np.array([0.1, 0.6, 1.1, 1.6]))
    assert np.allclose(fitted.parameters, [500.0, 0.1])
    study = palpate.Study(sys.argv[1], {"tissue.stiffness": [2e3, 4e3]}, ["peak contact.force"])
    assert len(study.points) == 2
    print(float(run.contact.force.max()))


main()
