"""With this folder on the path, a Python process and those that it starts lack the modules and names that only POSIX or
only Linux has. Other packages, and the modules of the standard library that they load, are not affected."""

import builtins
import importlib
import os
import select
import signal
import socket
import subprocess
import sys

PACKAGES = ["asyncio", "multiprocessing.connection", "numba", "scipy.linalg", "tempfile", "zmq.auth.thread"]
if "palpate.launch.run.work.spawner" not in sys.orig_argv:  # a worker needs no others
    PACKAGES += ["gymnasium", "matplotlib.pyplot", "psutil", "rich.console", "typer", "websockets.asyncio.server"]
if "palpate.models.build.on_demand" in sys.orig_argv:
    PACKAGES += ["pyvista"]  # of the meshing library
MODULES = "fcntl resource termios pwd grp pty tty readline syslog crypt"
NAMES = {
    os: """fork forkpty register_at_fork getuid geteuid getgid getegid getpgid setpgid setsid killpg uname pipe2 waitid
        wait sched_getaffinity sched_setaffinity sched_getscheduler sched_setscheduler sched_param SCHED_RR SCHED_OTHER
        getpriority setpriority mkfifo mknod fchmod fchown chown posix_spawn O_CLOEXEC O_NONBLOCK getloadavg
        nice pread pwrite memfd_create""",
    signal: """SIGALRM SIGHUP SIGCHLD SIGUSR1 SIGUSR2 SIGSTOP SIGCONT SIGPIPE SIGKILL SIGQUIT setitimer getitimer
        ITIMER_REAL alarm pthread_sigmask pthread_kill sigwait""",
    socket: "AF_UNIX SO_PEERCRED MSG_DONTWAIT",
    select: "epoll poll",
}


def hide():
    """Remove the names, /proc for palpate, and the options of `subprocess` that Windows refuses."""
    for name in PACKAGES:
        importlib.import_module(name)
    for name in MODULES.split():
        sys.modules[name] = None
    pair, unix = socket.socketpair, getattr(socket, "AF_UNIX", socket.AF_INET)
    socket.socketpair = lambda family=None, *given: pair(family or unix, *given)  # Windows emulates it by TCP
    for module, names in NAMES.items():
        for name in names.split():
            if hasattr(module, name):
                delattr(module, name)
    sys.platform = "other"
    known_open, known_listdir, known_popen = open, os.listdir, subprocess.Popen.__init__

    def check(path):
        ours = sys._getframe(2).f_globals.get("__name__", "").startswith("palpate")
        if ours and isinstance(path, str | os.PathLike) and os.fspath(path).startswith("/proc/"):
            raise FileNotFoundError(2, "No such file or directory", os.fspath(path))

    def opened(file, *given, **more):
        check(file)
        return known_open(file, *given, **more)

    def names_in(path="."):
        check(path)
        return known_listdir(path)

    def starts(self, *given, **more):
        if more.get("pass_fds") or more.get("preexec_fn"):
            raise ValueError("pass_fds and preexec_fn are not supported on Windows platforms")
        known_popen(self, *given, **more)

    builtins.open = opened
    subprocess.Popen.kill = lambda self: self.send_signal(9)  # it names SIGKILL
    os.listdir, subprocess.Popen.__init__ = names_in, starts


hide()
