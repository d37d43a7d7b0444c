"""Run benchmarks, one after another: ``python -m benchmarks [name ...]``.

Each prints times and their ratios to the usual alternatives, measured in the same run. Ratios
depend much less on the machine than times. No other program should run at the same time. The
benchmark ``scaling`` measures the growth of time and memory and rewrites ``docs/scaling.md`` with
its tables; it runs only if it is named.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parent


def main() -> None:
    """Run the requested benchmarks, by default all but ``scaling``."""
    names = sorted(path.stem for path in FOLDER.glob("[!_]*.py"))
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument(
        "name", nargs="*", help=f"one or more of {', '.join(names)}; by default all but scaling"
    )
    chosen = parser.parse_args().name or [name for name in names if name != "scaling"]
    unknown = sorted(set(chosen) - set(names))
    if unknown:
        parser.error(f"no benchmark {', '.join(unknown)}; available: {', '.join(names)}")
    folders = [str(FOLDER.parent), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(folders)}  # scaling uses `workflow`
    failed = []
    for name in chosen:
        print(f"\n=== {name}", flush=True)
        command = [sys.executable, FOLDER / f"{name}.py"]
        if subprocess.run(command, env=environment, check=False).returncode:
            failed.append(name)
    if failed:
        sys.exit(f"failed: {', '.join(failed)}")


if __name__ == "__main__":
    main()
