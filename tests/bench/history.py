"""The history of `make bench-all`: appends one line of JSON and draws a page of all lines.

    history.py RESULTS HISTORY PAGE

RESULTS is the folder with what the benchmarks wrote, one or several runs of each: solver_*.csv, live_*.json,
mesh_*.csv, pipeline_*.txt, gpu_*.csv; commit.txt with what was measured; and gpu.txt with the name of the CUDA device
where there is one. A figure has the median of its runs' medians, and an interval from the lowest to the highest end of
its runs' intervals: quartiles where a benchmark gives these, else its least value or its median alone.

A line of HISTORY holds the commit, the date, the device and the figures. A figure is slower than before where its
median is more than 5 % worse than in the line before of the same device and its interval does not overlap the interval
there. Slower figures are listed, and do not fail: the exit code is 0. A malformed file ends this with exit code 2,
and then nothing is written.
"""
import csv
import datetime
import json
import math
import os
import pathlib
import platform
import re
import statistics
import sys

from history_page import cells, device_name, page

ALLOWED_SLOWDOWN = 0.05
ALLOWED_LINE = ('{"commit": text, "date": text, "device": {"cpu": text, "threads": number, "gpu": text where one was '
                'used}, "figures": {NAME: {"unit": text, "median": number, "low": number, "high": number}}} '
                "with low <= median <= high")
GPU_SUBSTEPS = {"32", "64", "128"}  # of the many that bench_gpu tries
# What bench_pipeline prints: name of the figure, and the line that has its least value, its median and their unit.
PIPELINE = {"nothing to do, 6 stages": r"nothing to do, 6 stages: least ([\d.]+) ms, median ([\d.]+) (ms)",
            "engine's share per stage": r"share per stage started: least ([-\d.]+) ms, median ([-\d.]+) (ms)",
            "nothing to do, 1000 cases": r"nothing to do, 1000 cases .*: least ([\d.]+) s, median ([\d.]+) (s)",
            "nothing to do, 100 cases": r"nothing to do, 100 cases .*: least ([\d.]+) ms, median ([\d.]+) (ms)",
            "snakemake, 100 cases": r"snakemake on the same: least ([\d.]+) ms, median ([\d.]+) (ms)"}


def refuse(where, found, allowed, remedy):
    print(f"history: {where}: {found}\n  allowed: {allowed}\n  remedy:  {remedy}", file=sys.stderr)
    sys.exit(2)


# What each benchmark's file says, as (name of the figure, unit, median, low, high).

def of_solver(text):
    for row in csv.DictReader(text.splitlines()):
        threads = {"cuda": "cuda", "1": "1 thread"}.get(row["threads"], f"{row['threads']} threads")
        yield (f"{row['method']}, {row['scheme']}, {row['precision']}, {threads}", "ns a tet and substep",
               row["ns_per_tet_substep"], row["q1"], row["q3"])


def of_live(text):
    readout = json.loads(text)
    yield ("frames a second", "frames/s", *3 * [readout["frames_per_second"]])
    yield ("99th percentile of a frame", "ms", *3 * [readout["frame_ms"]["p99"]])


def of_mesh(text):
    for row in csv.DictReader(text.splitlines()):
        if row["cell_size_mm"] != "failed":
            yield (f"{row['method']}, meshing", "s", *3 * [row["meshing_s"]])
            yield (f"{row['method']}, whole stage", "s", *3 * [row["wall_s"]])


def of_pipeline(text):
    for name, pattern in PIPELINE.items():
        found = re.search(pattern, text)
        if found:
            least, median, unit = found.groups()
            yield name, unit, median, least, median
        elif not name.startswith("snakemake"):  # which need not be installed
            raise ValueError(f"no line like {pattern!r}")


def of_gpu(text):
    for row in csv.DictReader(text.splitlines()):
        if row["substeps"] in GPU_SUBSTEPS:
            yield (f"{row['element']}, {row['scheme']}, order {row['order']}, {row['substeps']} substeps",
                   "ms a frame", row["frame_ms"], row["q1"], row["q3"])


READERS = {"solver": of_solver, "live": of_live, "mesh": of_mesh, "pipeline": of_pipeline, "gpu": of_gpu}


def rounded(value):
    value = float(value)
    if not math.isfinite(value):
        raise ValueError(f"{value} is no time")
    return float(f"{value:.4g}")


def figures_of(results):
    runs = {}
    for bench, read in READERS.items():
        for file in sorted(results.glob(f"{bench}_*")):
            try:
                for name, unit, *values in read(file.read_text(encoding="utf-8")):
                    runs.setdefault((f"{bench}/{name}", unit), []).append([rounded(value) for value in values])
            except (ValueError, KeyError, TypeError) as error:
                refuse(file, f"not what the benchmark writes ({type(error).__name__}: {error})",
                       "the file of a benchmark that has ended", "make bench-all")
    if not runs:
        refuse(results, "no result of a benchmark", f"files named {', '.join(f'{b}_*' for b in READERS)}",
               "make bench-all")
    return {name: {"unit": unit, "median": statistics.median_low(run[0] for run in values),
                   "low": min(min(run) for run in values), "high": max(max(run) for run in values)}
            for (name, unit), values in runs.items()}


def device_of(results):
    info = pathlib.Path("/proc/cpuinfo")
    found = re.search(r"^model name\s*: (.*)", info.read_text(encoding="utf-8"), re.M) if info.is_file() else None
    device = {"cpu": found.group(1) if found else platform.machine(), "threads": len(os.sched_getaffinity(0))}
    gpu = results / "gpu.txt"
    if gpu.is_file():
        device["gpu"] = gpu.read_text(encoding="utf-8").splitlines()[0]
    return device


def problem_of(line):
    """What is wrong with a line of the history; none where it is as ALLOWED_LINE says."""
    def lacks(where, item, kinds):
        for key, kind in kinds.items():
            if not isinstance(item, dict) or key not in item:
                return f"{where} has no {key!r}"
            if not isinstance(item[key], kind) or isinstance(item[key], bool):
                return f"{where} has {item[key]!r} for {key!r}"
        return None

    number = (int, float)
    problem = lacks("the line", line, {"commit": str, "date": str, "device": dict, "figures": dict})
    problem = problem or lacks("the device", line["device"], {"cpu": str, "threads": int})
    problem = problem or lacks("the device", {"gpu": "", **line["device"]}, {"gpu": str})
    for name, figure in {} if problem else line["figures"].items():
        problem = problem or lacks(f"{name!r}", figure, {"unit": str, "median": number, "low": number, "high": number})
        if not problem and not -math.inf < figure["low"] <= figure["median"] <= figure["high"] < math.inf:
            problem = f"{name!r} has low {figure['low']}, median {figure['median']}, high {figure['high']}"
    return problem


def lines_of(history, text):
    lines = []
    for number, part in enumerate(text.splitlines(), 1):
        try:
            line = json.loads(part)
            problem = problem_of(line)
        except ValueError as error:  # no JSON, or no UTF-8
            problem = f"no line of JSON ({error})"
        if problem:
            refuse(f"{history}:{number}", problem, ALLOWED_LINE,
                   "mend or delete that line; the results stay: python3 " + " ".join(sys.argv) + " appends them")
        lines.append(line)
    return lines


def write(file, content):
    """All of it or nothing."""
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_name(file.name + ".part")
    try:
        part.write_bytes(content)
        part.replace(file.resolve())
    finally:
        part.unlink(missing_ok=True)


def is_slower(now, before):
    if now["unit"] != before["unit"]:
        return False
    if now["unit"].endswith("/s"):  # of a rate, more is better
        now, before = before, now
    return now["median"] > (1 + ALLOWED_SLOWDOWN) * before["median"] and now["low"] > before["high"]


def slowdowns(lines):
    """Of each device with slower figures: its newest line, the one before, and the figures' names."""
    of_device = {}
    for line in lines:
        of_device.setdefault(device_name(line), []).append(line)
    for own in of_device.values():
        now, before = own[-1], own[-2] if len(own) > 1 else {"figures": {}}
        names = [name for name, figure in now["figures"].items()
                 if name in before["figures"] and is_slower(figure, before["figures"][name])]
        if names:
            yield now, before, names


def main(results, history, to):
    results, history, to = map(pathlib.Path, (results, history, to))
    text = history.read_bytes() if history.is_file() else b""
    lines = lines_of(history, text)
    commit = results / "commit.txt"
    if not commit.is_file():
        refuse(commit, "no such file", "the commit that was measured", "make bench-all")
    now = datetime.datetime.now(datetime.timezone.utc)
    lines.append({"commit": commit.read_text(encoding="utf-8"), "date": f"{now:%Y-%m-%dT%H:%M:%SZ}",
                  "device": device_of(results), "figures": figures_of(results)})
    end = b"\n" if text and not text.endswith(b"\n") else b""
    slow = list(slowdowns(lines))
    drawn = page(lines, slow)
    write(history, text + end + json.dumps(lines[-1], ensure_ascii=False).encode() + b"\n")
    write(to, drawn.encode())
    print(f"{history}: line {len(lines)}, {len(lines[-1]['figures'])} figures of {lines[-1]['commit']}\n{to}")
    print("slower than before:" if slow else "slower than before: none")
    for now, before, names in slow:
        print(f"  {device_name(now)}, {now['commit']} against {before['commit']}:")
        for name in names:
            print("    {}: {} {}, before {}, {}".format(*cells(now, before, name)))


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
