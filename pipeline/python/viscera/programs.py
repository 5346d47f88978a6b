"""Runs of specs by viscera's programs, with their cache. Nothing but Python's own library, so that
any Python of version 3.9 or later can use this file, that of 3D Slicer among them."""

import csv
import json
import os
import pathlib
import shutil
import signal
import subprocess
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Optional, Union

Path = Union[str, "os.PathLike[str]"]

# Exit codes of a run whose results are there: all well, a gate failed, a simulation diverged.
HAVE_RESULTS = (0, 5, 7)


class Stage:
    """What a stage of a run left: its folder, and of its manifest.json the metrics and gates by name.

    caveats: sentences on what limits the result. passed: whether every gate did.
    """

    def __init__(self, folder: pathlib.Path) -> None:
        self.folder = folder
        self.manifest: dict[str, Any] = json.loads((folder / "manifest.json").read_text())
        self.metrics = {metric["name"]: metric["value"] for metric in self.manifest["metrics"]}
        self.gates = {gate["name"]: gate for gate in self.manifest["gates"]}
        self.caveats: list[str] = self.manifest.get("caveats", [])
        self.passed = all(gate["passed"] for gate in self.gates.values())

    def table(self, file: str) -> list[dict[str, Union[str, float, None]]]:
        """The rows of a .csv that the stage wrote, by column: metrics.csv, study.csv. Columns of numbers are such.

        pandas.DataFrame(stages["simulate"].table("metrics.csv"))
        """
        return _table(self.folder / file)

    def __repr__(self) -> str:
        return f"<stage in {self.folder}: {len(self.gates)} gates, {'passed' if self.passed else 'FAILED'}>"


def _table(file: pathlib.Path) -> list[dict[str, Union[str, float, None]]]:
    with open(file, newline="") as text:
        rows = list(csv.DictReader(text))
    columns = {name: _numbers([row[name] for row in rows]) for name in (rows[0] if rows else ())}
    return [{name: column[k] for name, column in columns.items()} for k in range(len(rows))]


def _numbers(column: list[str]) -> Sequence[Union[str, float, None]]:
    """A column of numbers alone as such, with None where it is empty; any other, such as one of digests, as it is."""
    try:
        return [float(text) if text else None for text in column]
    except ValueError:
        return column


class Failed(RuntimeError):
    """A run that ended with an error: what the programs said, and `exit_code`."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


class Cancelled(RuntimeError):
    """`progress` of run() has answered False."""


def program(name: str = "viscera") -> str:
    """The path of a program: beside VISCERA_BIN where that is set, else on the PATH."""
    folder = os.environ.get("VISCERA_BIN")
    found = shutil.which(name, path=folder) if folder else shutil.which(name)
    if not found:
        raise FileNotFoundError(
            f"{name}: not found {'in VISCERA_BIN, ' + folder if folder else 'on the PATH'}; make run builds it, "
            "and VISCERA_BIN names its folder")
    return found


def run(spec: Path, values: Optional[Mapping[str, object]] = None, *, out: Path = "out",
        cache: Optional[Path] = None, until: Optional[str] = None,
        progress: Optional[Callable[[float, str], Optional[bool]]] = None) -> dict[str, Stage]:
    """Runs a spec as `viscera run` does; what is in the cache is not computed again.

    values: variables and stages' params in place of the spec's, {"input": "scan.nrrd",
    "tetmesh.cell_size": "5 mm"}. out, cache: folders, of results and of what is kept. until: the last
    stage. progress(share, what) is called as the run goes on; where it answers False, the run ends with
    Cancelled, and nothing that was computed is lost.

    Returns the stages by name, "CASE/STAGE" where the spec has cases. Gates that fail are in them: only
    a run that could not be made raises Failed.
    """
    words = _words("run", spec, values, out, cache) + ["--progress", "jsonl"]
    if until is not None:
        words += ["--until", until]
    told = _Told(progress)
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
                          start_new_session=True) as running:
        try:
            assert running.stderr is not None
            for line in running.stderr:
                told.take(line)
        except BaseException:
            running.send_signal(signal.SIGINT)
            running.communicate()  # its stages end in order, and nothing half-written is kept
            raise
    if running.returncode not in HAVE_RESULTS:
        raise Failed("\n".join(told.errors) or f"viscera ended with exit code {running.returncode}",
                     running.returncode)
    folder = pathlib.Path(out) / pathlib.Path(spec).stem
    return {name: Stage(folder / name) for name in told.ended if (folder / name / "manifest.json").exists()}


def estimate(spec: Path, values: Optional[Mapping[str, object]] = None, *, out: Path = "out",
             cache: Optional[Path] = None) -> dict[str, Any]:
    """What run() would take, in a few seconds: `viscera estimate`. Nothing is written.

    Returns wall_s, the least and the most seconds of all that is not in the cache; memory_mb; unknown, the
    stages that say nothing; and stages, each with its name, state, wall_s and memory_mb where they are known, and
    words, among them how far off the body will be. Raises Failed where a stage refuses its params.
    """
    done = subprocess.run(_words("estimate", spec, values, out, cache) + ["--json"], capture_output=True, text=True,
                          check=False)
    if done.returncode != 0:
        raise Failed(done.stderr.strip(), done.returncode)
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def measured(data: Path, out: Path = "out/measured") -> list[dict[str, Union[str, float, None]]]:
    """What is computed of bodies that someone has measured, held against that: the program of `make measured`.

    data: the folder of the measurements; bodies whose files are not there are skipped. out: the folder that gets the page
    measured.md with its pictures. Takes minutes. Returns measured.csv: a row for each body, state and solver, with error,
    the error that was allowed before, and the measurement's own uncertainty. Raises Failed where data cannot be read.
    """
    done = subprocess.run([program("measured"), os.fspath(out), os.fspath(data)], stdout=subprocess.DEVNULL,
                          stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode != 0:
        raise Failed(done.stderr.strip(), done.returncode)
    return _table(pathlib.Path(out) / "measured.csv")


def _words(command: str, spec: Path, values: Optional[Mapping[str, object]], out: Path,
           cache: Optional[Path]) -> list[str]:
    """The command line that run() and estimate() have in common."""
    words = [program(), command, os.fspath(spec), "--out", os.fspath(out)]
    for name, value in (values or {}).items():
        words += ["--set", f"{name}={value if isinstance(value, str) else json.dumps(value)}"]
    if cache is not None:
        words += ["--cache", os.fspath(cache)]
    return words


class _Told:
    """What a run says, line by line of JSON: the stages that have ended, errors, and how far it is."""

    def __init__(self, progress: Optional[Callable[[float, str], Optional[bool]]]) -> None:
        self.progress = progress
        self.share = 0.0
        self.ended: list[str] = []
        self.errors: list[str] = []

    def take(self, line: str) -> None:
        try:
            what = json.loads(line)
        except ValueError:
            return
        if what.get("level") == "error":
            self.errors.append(what["message"])
        if "event" in what:
            stage = "/".join(part for part in (what["case"], what["stage"]) if part)
            if what["event"] != "started":
                self.ended.append(stage)
            self.share = what["settled"] / max(1, what["stages"])
            self.show(f"{stage}: {what['event']}")
        elif "progress" in what:
            self.show(f"{what['task']} {100 * what['progress']:.0f} % {what['detail']}".strip())

    def show(self, text: str) -> None:
        if self.progress and self.progress(self.share, text) is False:
            raise Cancelled("cancelled")
