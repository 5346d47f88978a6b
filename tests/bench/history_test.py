"""tests/bench/history.py on small results and lines that are made up."""
import copy
import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

HERE = pathlib.Path(__file__).resolve().parent
SOLVER = ("tets,method,scheme,precision,threads,ns_per_tet_substep,q1,q3,speedup,of_fastest,auto\n"
          '300,xpbd,"gauss_seidel, viscosity",fp32,1,{0},{1},{2},1,1,yes\n')
LIVE = '{{"frames_per_second": {0}, "frame_ms": {{"median": 1.0, "p99": {1}}}}}'
MESH = ('method,cell_size_mm,tets,meshing_s,time_ratio,wall_s\n"ours, labels",5,300,{0},1.00,{1}\n'
        '"gmsh HXT",failed\n')
PIPELINE = """nothing to do, 6 stages: least 8.5 ms, median 15.2 ms (goal 50 ms)
6 stages started: by the engine 125.6 ms, by hand 87.6 ms (medians)
engine's share per stage started: least 4.5 ms, median 6.3 ms (goal 20 ms)
nothing to do, 1000 cases x 5 stages: least 2.07 s, median 2.29 s (goal 3 s)
nothing to do, 100 cases x 5 stages: least 161 ms, median 244 ms
snakemake is not installed: nothing to compare with
"""
GPU = """tets,element,E_Pa,nu,scheme,order,substeps,frame_ms,q1,q3
300,linear,5000,0.45,block_gauss_seidel,2,64,0.3,0.29,0.31
300,linear,5000,0.45,block_gauss_seidel,2,66,0.3,0.29,0.31
"""
NS = "solver/xpbd, gauss_seidel, viscosity, fp32, 1 thread"
FPS = "live/frames a second"
NAMES = {NS, FPS, "live/99th percentile of a frame", "mesh/ours, labels, meshing", "mesh/ours, labels, whole stage",
         "pipeline/nothing to do, 6 stages", "pipeline/engine's share per stage", "pipeline/nothing to do, 1000 cases",
         "pipeline/nothing to do, 100 cases"}


class History(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder)
        self.results, self.history = self.folder / "results", self.folder / "history.jsonl"
        self.page = self.folder / "out/history.html"
        self.results.mkdir()
        for run, (ns, low, high, fps, p99, meshing, wall) in enumerate([(20.9, 20.7, 21, 10, 120, 0.9, 1.5),
                                                                       (21.1, 21, 21.3, 12, 100, 0.7, 1.6),
                                                                       (21, 20.8, 21.2, 11, 110, 0.8, 1.4)]):
            self.write(f"solver_{run}.csv", SOLVER.format(ns, low, high))
            self.write(f"live_{run}.json", LIVE.format(fps, p99))
            self.write(f"mesh_{run}.csv", MESH.format(meshing, wall))
        self.write("pipeline_1.txt", PIPELINE)
        self.write("commit.txt", "12ab34c+changes")

    def write(self, name, text):
        (self.results / name).write_text(text, encoding="utf-8")

    def run_history(self):
        return subprocess.run([sys.executable, HERE / "history.py", self.results, self.history, self.page],
                              capture_output=True, text=True)

    def append(self):
        """What a run says, and the lines that the history has then."""
        done = self.run_history()
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout, [json.loads(line) for line in self.history.read_text(encoding="utf-8").splitlines()]

    def after(self, **changes):
        """What a run says after one whose line was changed by what is given."""
        _, (line,) = self.append()
        line = copy.deepcopy(line)
        line["device"].update(changes.get("device", {}))
        for name in (NS, FPS):
            line["figures"][name].update(changes.get(name, {}))
        self.history.write_text(json.dumps(line) + "\n", encoding="utf-8")
        said, lines = self.append()
        self.assertEqual(len(lines), 2)
        self.assertEqual(lines[0], line)
        return said

    def test_a_line_holds_commit_date_device_and_figures_of_all_runs(self):
        _, (line,) = self.append()
        self.assertEqual(list(line), ["commit", "date", "device", "figures"])
        self.assertEqual(line["commit"], "12ab34c+changes")
        self.assertRegex(line["date"], r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ$")
        self.assertEqual(list(line["device"]), ["cpu", "threads"])
        self.assertEqual(set(line["figures"]), NAMES)
        self.assertEqual(line["figures"][NS], {"unit": "ns a tet and substep", "median": 21, "low": 20.7, "high": 21.3})
        self.assertEqual(line["figures"][FPS], {"unit": "frames/s", "median": 11, "low": 10, "high": 12})
        self.assertEqual(line["figures"]["mesh/ours, labels, meshing"],
                         {"unit": "s", "median": 0.8, "low": 0.7, "high": 0.9})
        self.assertEqual(line["figures"]["pipeline/engine's share per stage"],
                         {"unit": "ms", "median": 6.3, "low": 4.5, "high": 6.3})

    def test_results_of_a_gpu_name_it(self):
        self.write("gpu_1.csv", GPU)
        self.write("gpu.txt", "Some GPU\nSome GPU\n")
        _, (line,) = self.append()
        self.assertEqual(line["device"]["gpu"], "Some GPU")
        self.assertEqual(line["figures"]["gpu/linear, block_gauss_seidel, order 2, 64 substeps"],
                         {"unit": "ms a frame", "median": 0.3, "low": 0.29, "high": 0.31})
        self.assertEqual(len(line["figures"]), len(NAMES) + 1)

    def test_a_second_run_is_one_more_line(self):
        said = self.after()
        self.assertIn("slower than before: none", said)
        self.assertIn("No figure of the newest line", self.page.read_text(encoding="utf-8"))

    def test_six_percent_outside_the_interval_is_slower(self):
        said = self.after(**{NS: {"median": 21 / 1.06, "low": 19, "high": 20.6}})
        self.assertRegex(said, f"slower than before:\n  .*:\n    {NS}: .*\\+6 %")
        page = self.page.read_text(encoding="utf-8")
        self.assertRegex(page, f"<td>{NS}<td>.*<td>\\+6 %")
        self.assertEqual(page.count('class="slow"'), 1)

    def test_six_percent_within_the_interval_is_not(self):
        self.assertIn("before: none", self.after(**{NS: {"median": 21 / 1.06, "low": 19, "high": 20.8}}))

    def test_four_percent_outside_the_interval_is_not(self):
        self.assertIn("before: none", self.after(**{NS: {"median": 21 / 1.04, "low": 19, "high": 20.6}}))

    def test_of_a_rate_less_is_slower(self):
        self.assertRegex(self.after(**{FPS: {"median": 12.5, "low": 12.1, "high": 13}}), f"\n    {FPS}: .*-12 %")
        self.history.unlink()
        self.assertIn("before: none", self.after(**{FPS: {"median": 9, "low": 8, "high": 9.5}}))

    def test_lines_of_another_device_are_not_compared(self):
        faster = {"median": 10, "low": 9, "high": 11}
        for device in ({"cpu": "Another"}, {"threads": 4096}, {"gpu": "Some GPU"}):
            self.assertIn("before: none", self.after(**{NS: faster, "device": device}))
            self.history.unlink()

    def test_a_line_is_compared_with_the_last_one_of_its_device(self):
        self.after(**{NS: {"median": 10, "low": 9, "high": 11}})
        fast, same = self.history.read_text(encoding="utf-8").splitlines()
        other = same.replace('"cpu": "', '"cpu": "not ')
        for lines, is_listed in [([fast, other], True), ([same, fast, other], True), ([fast, same, other], False)]:
            self.history.write_text("\n".join(lines), encoding="utf-8")  # without a newline at its end
            said, lines_then = self.append()
            self.assertEqual(len(lines_then), len(lines) + 1)
            self.assertEqual(f"    {NS}: " in said, is_listed, lines)

    def test_a_plot_for_each_figure_and_nothing_from_elsewhere(self):
        self.after()
        page = self.page.read_text(encoding="utf-8")
        self.assertEqual(page.count("<svg"), len(NAMES))
        self.assertEqual(page.count("<circle"), 2 * len(NAMES))
        for name in NAMES:
            self.assertIn(f"<figcaption>{name.split('/')[1].replace(chr(39), '&#x27;')} <small>", page)
        self.assertIsNone(re.search(r"https?:|src=|@import|nan|inf\b", page))

    def test_a_malformed_line_is_refused_with_its_number_and_nothing_is_written(self):
        self.append()
        good = self.history.read_text(encoding="utf-8")
        self.page.unlink()
        line = json.loads(good)
        low_above = copy.deepcopy(line)
        low_above["figures"][NS]["low"] = 22
        for bad, found in [(good[:40], "no line of JSON"), ("", "no line of JSON"), ("7", "no 'commit'"),
                           (json.dumps({**line, "device": {"cpu": "A"}}), "no 'threads'"),
                           (json.dumps({**line, "figures": {NS: {"unit": "ns"}}}), "no 'median'"),
                           (json.dumps(low_above), "low 22, median 21"),
                           (json.dumps(low_above).replace("22", "NaN"), "low nan")]:
            text = good + bad + "\n" + good
            self.history.write_text(text, encoding="utf-8")
            done = self.run_history()
            self.assertEqual(done.returncode, 2)
            self.assertRegex(done.stderr, rf"history: .*history\.jsonl:2: .*{found}.*\n  allowed: .*\n  remedy:  ")
            self.assertEqual(self.history.read_text(encoding="utf-8"), text)
            self.assertEqual({path.name for path in self.folder.rglob("history*")}, {"history.jsonl"})

    def test_a_result_that_is_cut_short_is_refused_and_nothing_is_written(self):
        for name, text in [("solver_1.csv", "tets,method\n300,xpbd\n"), ("live_1.json", '{"frames'),
                           ("live_1.json", LIVE.format("null", 1)), ("pipeline_1.txt", PIPELINE[:200])]:
            before = (self.results / name).read_text(encoding="utf-8")
            self.write(name, text)
            done = self.run_history()
            self.assertEqual(done.returncode, 2)
            self.assertIn(name, done.stderr)
            self.assertFalse(self.history.exists() or self.page.exists())
            self.write(name, before)
        (self.results / "commit.txt").unlink()
        done = self.run_history()
        self.assertEqual(done.returncode, 2)
        self.assertIn("commit.txt: no such file", done.stderr)


if __name__ == "__main__":
    unittest.main()
