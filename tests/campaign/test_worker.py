"""Scripts in the worker of a run: they begin with all in memory and end as if they ran alone."""

import ast
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from campaign_folder import ROOT

from cislunar.runtime import worker_client
from cislunar.runtime.worker_client import FOLDER

SCRIPTS = sorted((ROOT / "workflow/scripts").glob("*.py"))
LIMIT_S = 1800.0
"""So long that only a failure exceeds it, also on a busy machine."""

BEGINNING = "from cislunar.runtime.worker_client import in_worker\n\nin_worker("

pytestmark = pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="there is none beyond Linux")


class Run:
    """What stands for a Snakemake whose jobs share a worker."""

    def __init__(self, scripts):
        self.scripts = scripts
        self.process = subprocess.Popen(["sleep", str(2.0 * LIMIT_S)])
        name = f"cislunar-{os.getuid()}-{self.process.pid}"
        self.folder = Path(tempfile.gettempdir()) / name

    def start(self, text, **environment):
        """Start a script that goes to the worker."""
        path = self.scripts / f"script{len(list(self.scripts.iterdir()))}.py"
        path.write_text(f"{BEGINNING})\n\n{text}", encoding="utf-8")
        return subprocess.Popen(
            [sys.executable, str(path)],
            env=os.environ | {FOLDER: str(self.folder)} | environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def outcome(self, text, **environment):
        """Output, errors and exit code of a script."""
        script = self.start(text, **environment)
        return *script.communicate(timeout=LIMIT_S), script.returncode

    def end(self):
        self.process.kill()
        self.process.wait()


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    run = Run(tmp_path_factory.mktemp("scripts"))
    yield run
    run.end()


def first_line(script):
    """What a script says first; it is at work then."""
    return script.stdout.readline().strip()


def waited(condition):
    """Whether a condition becomes true, waiting for it."""
    start = time.monotonic()
    while not condition() and time.monotonic() - start < LIMIT_S:
        time.sleep(0.02)
    return condition()


def test_a_script_finds_its_imports_in_memory_and_its_own_surroundings(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = """
import sys
print("colorsys" in sys.modules)
import os
print(os.getcwd(), os.environ["ASKED"], os.getppid())
print("said", file=sys.stderr)
import colorsys
sys.exit(3)
"""
    output, errors, code = run.outcome(text, ASKED="yes")
    loaded, (folder, asked, worker) = (line.split() for line in output.splitlines())
    assert loaded == ["True"]
    assert (folder, asked, errors, code) == (str(tmp_path), "yes", "said\n", 3)
    again = run.outcome("import os\nprint(os.getppid())")
    assert again == (f"{worker}\n", "", 0)


def test_an_error_is_told_where_it_rose(run):
    _, errors, code = run.outcome("import no_such_module")
    assert code == 1
    assert "ModuleNotFoundError: No module named 'no_such_module'" in errors


def test_a_killed_job_kills_who_waits_for_it_and_nobody_else(run):
    other = run.start("import time\nprint(1, flush=True)\ntime.sleep(1)\nprint(2)")
    assert first_line(other) == "1"
    assert run.outcome("import os\nos.kill(os.getpid(), 9)")[2] == -signal.SIGKILL
    assert other.communicate(timeout=LIMIT_S) == ("2\n", "")


STOPPED = """
import os, pathlib, signal, sys, time
signal.signal(signal.SIGTERM, lambda *_: (pathlib.Path(os.environ["NOTE"]).touch(), sys.exit(143)))
print("at work", flush=True)
time.sleep(600)
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_who_waits_is_stopped_and_so_is_the_job(run, tmp_path, number):
    script = run.start(STOPPED, NOTE=str(tmp_path / "note"))
    assert first_line(script) == "at work"
    script.send_signal(number)
    assert script.wait(LIMIT_S) == (143 if number == signal.SIGTERM else -number)
    assert waited((tmp_path / "note").exists)


def test_the_worker_goes_with_its_run_and_leaves_jobs_to_end(tmp_path):
    own = Run(tmp_path)
    text = "import os, time\nprint(os.getppid(), flush=True)\ntime.sleep(1)\nprint('whole')"
    script = own.start(text)
    worker = int(first_line(script))
    own.end()
    assert waited(lambda: not own.folder.exists())
    assert script.communicate(timeout=LIMIT_S) == ("whole\n", "")
    assert waited(lambda: not Path(f"/proc/{worker}/exe").exists())


def test_without_a_worker_a_script_goes_on_by_itself(run):
    output, _, code = run.outcome("import os\nprint(os.getppid())", **{FOLDER: ""})
    assert (output, code) == (f"{os.getpid()}\n", 0)


def test_only_the_main_process_of_a_run_offers_a_worker(monkeypatch):
    for name in worker_client._COMMON:
        monkeypatch.setenv(name, "of the user")
    monkeypatch.setenv(FOLDER, "of another run")
    worker_client.offer_worker(main=False)
    assert FOLDER not in os.environ
    worker_client.offer_worker(main=True)
    assert os.environ[FOLDER].endswith(f"-{os.getpid()}")
    monkeypatch.setenv(FOLDER, "")
    worker_client.offer_worker(main=True)
    assert os.environ[FOLDER] == ""


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_every_script_begins_in_the_worker(path):
    _, *body = ast.parse(path.read_text(encoding="utf-8")).body
    if body[0].module == "cislunar.campaign.kernels":  # names the kernels that the worker loads
        del body[0]
    imported, handed, *_ = body
    assert imported.module == worker_client.__name__
    assert handed.value.func.id == "in_worker"


def test_numpy_and_openblas_use_common_instructions(monkeypatch):
    names = [*worker_client._COMMON]
    monkeypatch.setenv(names[0], "of the user")
    monkeypatch.setenv(names[1], "")
    monkeypatch.delenv(names[1])
    worker_client.use_common_instructions()
    if names[1] not in os.environ:
        pytest.skip("this processor lacks the instructions of x86-64-v3")
    assert os.environ[names[0]] == "of the user"
    monkeypatch.delenv(names[0])
    program = (
        "from cislunar.runtime.worker_client import use_common_instructions as use; use();"
        "import scipy.linalg; from numpy._core._multiarray_umath import __cpu_features__ as found;"
        "from threadpoolctl import threadpool_info as info;"
        "print(found['X86_V3'], found['X86_V4'],"
        "*{each['architecture'] for each in info() if each['internal_api'] == 'openblas'})"
    )
    command = [sys.executable, "-W", "error", "-c", program]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert told.split() == ["True", "False", "Haswell"]


def test_tracking_loads_neither_hyperopt_nor_matplotlib():
    text = (ROOT / "workflow/scripts/tracking_cell.py").read_text(encoding="utf-8")
    imports = [
        ast.unparse(node) for node in ast.parse(text).body if isinstance(node, ast.ImportFrom)
    ]
    told = "import sys\nprint(*sys.modules)"
    command = [sys.executable, "-c", "\n".join([*imports, told])]
    loaded = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert "cislunar.tasking.closed_loop" in loaded
    assert not {"hyperopt", "matplotlib", "plotly", "sklearn", "snakemake"} & set(loaded)
