"""Client of the worker of a run: a script submits its work, waits, and ends as the job does.

See `cislunar.runtime.worker`. Few modules are imported here, since every job has to load them.
"""

import contextlib
import fcntl
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

FOLDER = "CISLUNAR_WORKER"
"""Environment variable with the folder of the worker; empty for no worker."""

_FORKED = "forked"
"""Its value in a job that the worker has forked."""

_WORKER = "cislunar.runtime.worker"
SOCKET, LOCK, LOG = "socket", "lock", "log"
"""Files in the folder of the worker."""

LONGEST_MESSAGE = 1 << 20

# One thread for linear algebra, as in jobs, and because the worker forks.
_ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMEXPR")}

_COMMON = {
    "OPENBLAS_CORETYPE": "Haswell",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
}
"""Settings with which OpenBLAS and NumPy use the instructions of the level x86-64-v3 and no others.
Others change the last digits of results, and with these the plan of a survey."""


def use_common_instructions() -> None:
    """Let OpenBLAS and NumPy compute the same digits on all processors of the level x86-64-v3.

    This has to precede the first import of NumPy. What the environment states already is kept."""
    try:
        words = set(Path("/proc/cpuinfo").read_text(encoding="utf-8").partition("\n\n")[0].split())
    except OSError:
        return
    if {"avx2", "bmi2", "fma"} <= words:
        for name, value in _COMMON.items():
            os.environ.setdefault(name, value)


def offer_worker(main: bool) -> None:
    """Offer a worker to the jobs of this process, if it is the `main` process of a run. Nothing is
    started yet. There is no worker if the environment variable is set but empty. All jobs use
    common instructions."""
    use_common_instructions()
    if os.environ.get(FOLDER) == "":
        return
    os.environ.pop(FOLDER, None)
    if main and hasattr(os, "pidfd_open"):
        name = f"cislunar-{os.getuid()}-{os.getpid()}"
        os.environ[FOLDER] = str(Path(tempfile.gettempdir()) / name)


def in_worker(kernels: str = "", function: str = "") -> None:
    """Run this script in the worker of its run and end with it; return if there is no worker.
    `kernels` names the kernels to be loaded first, see `cislunar.runtime.kernels`, and `function`
    the function that the script calls, whose module the worker imports."""
    folder = os.environ.get(FOLDER)
    if folder == _FORKED:
        return
    connection = _connection(Path(folder)) if folder else None
    if connection is None:
        if kernels:
            from cislunar.runtime.kernels import compile_kernels

            compile_kernels(kernels)
        return
    request = {
        "script": os.path.abspath(sys.argv[0]),
        "kernels": kernels,
        "function": function,
        "cwd": os.getcwd(),
        "environ": {**os.environ, FOLDER: _FORKED},
    }
    with connection:
        socket.send_fds(connection, [json.dumps(request).encode()], [0, 1, 2])
        code = _outcome(connection, folder)
    if code < 0:
        with contextlib.suppress(OSError):  # SIGKILL has no handler
            signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    sys.exit(code)


def _connection(folder: Path) -> socket.socket | None:
    """A connection to the worker, which is started if necessary; None if that fails."""
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        if folder.stat().st_uid != os.getuid():
            return None
        with open(folder / LOCK, "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            return _connected(folder) or (_connected(folder) if _started(folder) else None)
    except OSError:
        return None


def _connected(folder: Path) -> socket.socket | None:
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        connection.connect(str(folder / SOCKET))
    except OSError:
        connection.close()
        return None
    return connection


def _started(folder: Path) -> bool:
    """Start the worker; true when it listens. Its messages go to a log beside it."""
    # -P: packages come from where they are installed, as in scripts.
    command = [sys.executable, "-P", "-m", _WORKER, str(folder)]
    with open(folder / LOG, "w") as log:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=log,
            env=os.environ | _ONE_THREAD,
        )
    return process.stdout.readline() == b"listening\n"


def _outcome(connection: socket.socket, folder: str) -> int:
    """Wait for the job; its exit code, or the negative number of the signal that ended it."""
    job: list[int] = []

    def stop(number: int, frame: Any) -> None:
        if not job:
            os._exit(128 + number)
        with contextlib.suppress(ProcessLookupError):
            os.kill(job[0], number)

    signal.signal(signal.SIGTERM, stop)
    # A terminal sends an interrupt to the job as well, which reports it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    while answer := connection.recv(LONGEST_MESSAGE):
        kind, value = json.loads(answer)
        if kind == "code":
            return value
        job.append(value)
    print(
        f"error: the worker died (see {folder}/{LOG}); run the same command again", file=sys.stderr
    )
    return 1
