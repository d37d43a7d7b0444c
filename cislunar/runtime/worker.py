"""One process for the jobs of a run, which imports the library once and forks for every job.

The first line of every script passes the script to the worker of its run
(`cislunar.runtime.worker_client`), which the first job starts. The worker imports the modules that
the script imports or names, loads the kernels that it names, and forks. The job runs in a process
of its own, with terminal, folder and environment of the process that submitted it, which waits and
ends with the same exit code or signal. The worker ends with its run. It starts no threads, which a
fork would lose. Without a worker, as on nodes of a cluster and beyond Linux, a script runs in its
own process.
"""

import ast
import contextlib
import gc
import importlib
import json
import os
import pkgutil
import runpy
import selectors
import signal
import socket
import sys
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from cislunar.runtime.kernels import compile_kernels
from cislunar.runtime.provenance import git_revision
from cislunar.runtime.worker_client import LOCK, LOG, LONGEST_MESSAGE, SOCKET

_PATIENCE_S, _INTERRUPTED = 60.0, 130


class _Request(NamedTuple):
    """A submitted job, and the connection to the process that waits for it."""

    connection: socket.socket
    streams: list[int]
    script: str
    kernels: str
    function: str
    cwd: str
    environ: dict[str, str]

    def close(self) -> None:
        self.connection.close()
        for stream in self.streams:
            os.close(stream)

    def tell(self, kind: str, value: int) -> bool:
        """Send a message; whether the process that waits for the job is still there."""
        try:
            self.connection.send(json.dumps([kind, value]).encode())
        except OSError:
            return False
        return True


class _Worker:
    """Running jobs, jobs that wait for kernels, and the loaded kernels."""

    def __init__(self, folder: Path, run: int) -> None:
        self.folder = folder
        self.run = os.pidfd_open(run)
        self.selector = selectors.DefaultSelector()
        self.running: dict[int, int] = {}
        self.requests: list[_Request] = []
        self.waiting: dict[str, list[_Request]] = {}
        self.loaded = {""}
        self.listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        path = folder / SOCKET
        path.unlink(missing_ok=True)
        self.listener.bind(str(path))
        self.listener.listen()
        self.listens = True
        self.selector.register(self.listener, selectors.EVENT_READ, self.accept)
        self.selector.register(self.run, selectors.EVENT_READ, self.leave)

    def serve(self) -> None:
        """Serve until the run and its last jobs have ended."""
        while self.listens or self.running:
            for key, _ in self.selector.select():
                key.data()

    def leave(self) -> None:
        """The run has ended: accept no more jobs."""
        self.selector.unregister(self.listener)
        self.selector.unregister(self.run)
        self.listener.close()
        self.listens = False
        for name in (SOCKET, LOCK, LOG):
            (self.folder / name).unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self.folder.rmdir()

    def accept(self) -> None:
        """Accept a job: fork, now or when its kernels are loaded."""
        connection, _ = self.listener.accept()
        connection.settimeout(_PATIENCE_S)
        try:
            message, streams, _, _ = socket.recv_fds(connection, LONGEST_MESSAGE, 3)
        except OSError:
            message, streams = b"", []
        if not message:
            connection.close()
            return
        request = _Request(connection, streams, **json.loads(message))
        self.requests.append(request)
        _import_what_it_imports(request)
        if request.kernels in self.loaded:
            self.start(request)
        elif request.kernels in self.waiting:
            self.waiting[request.kernels].append(request)
        else:
            self.waiting[request.kernels] = [request]
            self.fork(
                request, lambda: compile_kernels(request.kernels), self.prepared(request.kernels)
            )

    def prepared(self, kernels: str) -> Callable[[int], None]:
        """Callback for the end of a process that compiled kernels."""

        def end(code: int) -> None:
            requests = self.waiting.pop(kernels)
            if code == _INTERRUPTED or code < 0:
                for request in requests:
                    self.answer(request, code)
                return
            # A failure repeats in the job, which reports it.
            if code == 0:
                compile_kernels(kernels)
            self.loaded.add(kernels)
            for request in requests:
                self.start(request)

        return end

    def answer(self, request: _Request, code: int) -> None:
        """Report the end of a job."""
        request.tell("code", code)
        self.requests.remove(request)
        request.close()

    def start(self, request: _Request) -> None:
        """Fork for a job and report its process and its end."""

        def end(code: int) -> None:
            with contextlib.suppress(KeyError):
                self.selector.unregister(request.connection)
            self.answer(request, code)

        pid = self.fork(request, partial(runpy.run_path, request.script, run_name="__main__"), end)

        def stop() -> None:
            """Called when no process waits for the job any more."""
            os.kill(pid, signal.SIGTERM)
            self.selector.unregister(request.connection)

        self.selector.register(request.connection, selectors.EVENT_READ, stop)
        if not request.tell("pid", pid):
            stop()

    def fork(self, request: _Request, work: Callable[[], Any], end: Callable[[int], None]) -> int:
        """Do some work in a process of its own, then call `end` with its exit code."""
        gc.freeze()
        pid = os.fork()
        if pid == 0:
            self.let_go(request)
            _do(work, request)
        handle = os.pidfd_open(pid)

        def reap() -> None:
            self.selector.unregister(handle)
            os.close(handle)
            del self.running[pid]
            end(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))

        self.running[pid] = handle
        self.selector.register(handle, selectors.EVENT_READ, reap)
        return pid

    def let_go(self, request: _Request) -> None:
        """In a fork: close the handles of the worker."""
        for number, stream in enumerate(request.streams):
            os.dup2(stream, number)
        self.selector.close()
        self.listener.close()
        for handle in (self.run, *self.running.values()):
            os.close(handle)
        for each in self.requests:
            each.close()


def _do(work: Callable[[], Any], request: _Request) -> NoReturn:
    """Work and end as a process of its own would."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.environ.clear()
    os.environ.update(request.environ)
    code = 1
    try:
        os.chdir(request.cwd)
        sys.argv = [request.script]
        work()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except KeyboardInterrupt:
        print("interrupted; run the same command again", file=sys.stderr)
        code = _INTERRUPTED
    except BaseException:
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        os._exit(code)


def _import_what_it_imports(request: _Request) -> None:
    """Import the modules that the top level of a script imports, and that of the function that it
    calls; a failure repeats in the job."""
    with contextlib.suppress(Exception):
        for node in ast.parse(Path(request.script).read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom) and node.module:
                module = importlib.import_module(node.module)
                for name in node.names:
                    getattr(module, name.name)
            elif isinstance(node, ast.Import):
                for name in node.names:
                    importlib.import_module(name.name)
        if request.function:
            pkgutil.resolve_name(request.function)


def main() -> None:
    """Serve the jobs of a run; started by the first of them."""
    # An interrupt at the terminal is for the jobs; the worker ends with its run.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    folder = Path(sys.argv[1])
    worker = _Worker(folder, int(folder.name.rsplit("-", 1)[1]))
    os.write(1, b"listening\n")
    os.dup2(2, 1)
    git_revision()  # kept for every data set
    worker.serve()


if __name__ == "__main__":
    main()
