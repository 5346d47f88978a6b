"""The documentation site's pages, made by docs/site/generate.py, held against the programs.

    site_test.py BIN
"""
import hashlib
import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
SITE = ROOT / "docs/site"
BIN = pathlib.Path(sys.argv.pop(1)).resolve()
sys.path.insert(0, str(SITE / "gallery"))
import gallery  # noqa: E402

SCENE_HEAD = "scene: 1\n"
MATERIALS = "materials: {liver: {E: 5 kPa, nu: 0.45, density: 1060 kg/m3}}\n"


def run(*command):
    return subprocess.run([str(part) for part in command], capture_output=True, text=True)


def generated(folder, site=SITE):
    return run(sys.executable, SITE / "generate.py", BIN, folder / "pages", site)


def write_runs(folder):
    """What the runs of the gallery leave, with numbers that no run has."""
    for number, scene in enumerate(gallery.scenes().items()):
        name, file = scene
        simulation = folder / name / "simulate"
        simulation.mkdir(parents=True)
        metrics = {"tets": 1234 + number, "substeps": 77, "frames": 91, "frame_ms_median": 12.56,
                   "cpu_model": "Some Processor", "effects_on": ["gravity", "neo_hookean"]}
        manifest = {"inputs": [{"role": "scene", "sha256": hashlib.sha256(file.read_bytes()).hexdigest()}],
                    "metrics": [{"name": key, "value": value} for key, value in metrics.items()],
                    "device": "cpu, 3 threads", "wall_s": 4.56}
        (simulation / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
        (simulation / "scene.json").write_text('{"time": {"frame": 0.02}, "effects": {}}', encoding="utf-8")


def draw_nothing(_folder, _scene, _view, picture):
    picture.write_bytes(b"a picture")


def prose(text):
    """Without blocks and spans of code."""
    text = re.sub(r"^```.*?^```$", "", text, flags=re.M | re.S)
    return re.sub(r"`[^`\n]*`", "", re.sub(r"^(?: {4}.*\n)+", "", text, flags=re.M))


class Site(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp())
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        write_runs(cls.folder / "runs")
        gallery.write(cls.folder / "runs", cls.folder / "gallery", draw_nothing)
        done = generated(cls.folder)
        assert done.returncode == 0, done.stderr
        cls.pages = cls.folder / "pages"

    def test_every_stage_has_a_page_with_all_that_it_declares(self):
        """Every stage has a page."""
        names = json.loads(run(BIN / "viscera", "schema").stdout)["properties"]["stages"]["properties"]
        self.assertGreaterEqual(len(names), 7)
        for name in names:
            stage = json.loads(run(BIN / f"viscera-{name}", "describe").stdout)
            text = (self.pages / "stages" / f"{name}.md").read_text(encoding="utf-8")
            for item in ([i["role"] for i in stage["inputs"]] + [o["file"] for o in stage["outputs"]] +
                         [p["name"] for p in stage["params"]] + [g["name"] for g in stage["gates"]]):
                self.assertIn(f"\n| `{item}` |", text, name)

    def test_every_relative_link_leads_to_a_file(self):
        count = 0
        for page in self.pages.rglob("*.md"):
            for link in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", prose(page.read_text(encoding="utf-8"))):
                # What doxygen and the build draw is not here.
                if re.match(r"[a-z]+:", link) or link.startswith("api/") or link == "targets.svg":
                    continue
                self.assertTrue((page.parent / link).is_file(), f"{page}: {link}")
                count += 1
        self.assertGreater(count, 60)

    def test_every_example_in_yaml_is_taken_by_the_programs(self):
        examples = {"scene": 0, "spec": 0}
        shutil.copytree(ROOT / "configs", self.folder / "examples/configs")
        shutil.copytree(ROOT / "sample_data", self.folder / "examples/sample_data",
                        ignore=shutil.ignore_patterns("*.cpp"))
        for page in sorted(self.pages.rglob("*.md")):
            spec = ""
            for text in re.findall(r"^```yaml\n(.*?)^```$", page.read_text(encoding="utf-8"), re.M | re.S):
                file = self.folder / "examples/configs/example.yaml"
                if re.search(r"^effects:", text, re.M):
                    head = "" if text.find("scene: 1") >= 0 else SCENE_HEAD
                    head += "" if re.search("^materials:", text, re.M) else MATERIALS
                    file.write_text(head + text, encoding="utf-8")
                    done = run(BIN / "viscera-simulate", "check", "--in", f"mesh={file}", "--in",
                               f"scene={file}")
                    examples["scene"] += 1
                else:
                    if re.search("^viscera: 1", text, re.M):
                        spec = text
                    else:  # goes on from the spec before it, with the variable E that it speaks of
                        text = spec.replace("vars:\n", "vars:\n  E: 5 kPa\n") + text
                    file.write_text(text, encoding="utf-8")
                    done = run(BIN / "viscera", "run", file, "--dry-run", "--out", self.folder / "out",
                               "--set", f"input={ROOT / 'sample_data/phantom.nrrd'}")
                    examples["spec"] += 1
                self.assertEqual(done.returncode, 0, f"{page}:\n{text}\n{done.stderr}")
        self.assertGreaterEqual(examples["scene"], 24)
        self.assertGreaterEqual(examples["spec"], 3)

    def refused(self, change):
        site = self.folder / "site"
        shutil.copytree(SITE, site)
        self.addCleanup(shutil.rmtree, site)
        change(site / "effects")
        with tempfile.TemporaryDirectory() as folder:
            done = generated(pathlib.Path(folder), site)
        self.assertEqual(done.returncode, 1, done.stderr)
        return done.stderr

    def test_an_effect_without_a_page_is_refused(self):
        self.assertIn("the effect gravity has no page",
                      self.refused(lambda effects: (effects / "gravity.md").unlink()))

    def test_a_page_without_an_effect_is_refused(self):
        self.assertIn("levity.md is the page of no effect",
                      self.refused(lambda effects: shutil.copy(effects / "gravity.md", effects / "levity.md")))

    def test_a_page_that_names_a_test_which_is_not_there_is_refused(self):
        def change(effects):
            text = (effects / "gravity.md").read_text(encoding="utf-8")
            text = text.replace("Motion.FreeFall", "Motion.FreeRise")
            (effects / "gravity.md").write_text(text, encoding="utf-8")

        self.assertIn("which is not there", self.refused(change))

    def test_the_gallery_is_in_the_navigation(self):
        config = (self.folder / "mkdocs.yml").read_text(encoding="utf-8")
        for name in gallery.scenes():
            self.assertIn(f'"gallery/{name}.md"', config)

    def test_a_site_without_the_gallery_says_how_to_make_it(self):
        with tempfile.TemporaryDirectory() as folder:
            done = generated(pathlib.Path(folder))
            self.assertEqual(done.returncode, 0, done.stderr)
            text = (pathlib.Path(folder) / "pages/gallery/index.md").read_text(encoding="utf-8")
        self.assertIn("`make gallery`", text)


class Gallery(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder)
        self.runs = self.folder / "runs"
        self.pages = self.folder / "gallery"
        write_runs(self.runs)

    def write(self, draw=draw_nothing):
        gallery.write(self.runs, self.pages, draw)

    def test_has_eight_scenes_each_with_words_and_a_view(self):
        """The gallery has eight scenes."""
        scenes = gallery.scenes()
        self.assertEqual(len(scenes), 8)
        views = json.loads((SITE / "gallery/views.json").read_text(encoding="utf-8"))
        self.assertEqual(set(views), set(scenes))
        self.assertEqual({path.stem for path in (SITE / "gallery").glob("*.md")}, set(scenes))
        self.assertLessEqual(set((ROOT / "configs/gallery").glob("*.yaml")), set(scenes.values()))
        for name in scenes:
            title, text = gallery.words_of(name)
            self.assertGreater(len(title), 5, name)
            self.assertGreater(len(text), 100, name)

    def test_every_scene_is_taken_by_the_programs(self):
        done = run(BIN / "viscera", "run", gallery.SPEC, "--dry-run", "--out", self.folder)
        self.assertEqual(done.returncode, 0, done.stderr)
        for name, scene in gallery.scenes().items():
            self.assertIn(f"{name}/simulate: would run", done.stdout + done.stderr)
            done_alone = run(BIN / "viscera-simulate", "check", "--in", f"mesh={scene}", "--in", f"scene={scene}")
            self.assertEqual(done_alone.returncode, 0, done_alone.stderr)

    def test_a_page_shows_picture_words_scene_and_what_the_run_measured(self):
        self.write()
        index = (self.pages / "index.md").read_text(encoding="utf-8")
        for number, (name, scene) in enumerate(gallery.scenes().items()):
            page = (self.pages / f"{name}.md").read_text(encoding="utf-8")
            title, text = gallery.words_of(name)
            costs = f"| {1234 + number} | 77 | 12.6 ms | 63 % | 1.80 s | 4.6 s |"
            for part in [f"# {title}\n", f"]({name}.png)", text, costs, "Some Processor (cpu, 3 threads)",
                         "[gravity](../effects/gravity.md)", scene.read_text(encoding="utf-8").strip()]:
                self.assertIn(part, page)
            self.assertIn(f"| [{title}]({name}.md) {costs}", index)
            self.assertEqual((self.pages / f"{name}.png").read_bytes(), b"a picture")

    def leaves_what_there_was(self, message, draw=draw_nothing):
        self.pages.mkdir()
        (self.pages / "index.md").write_text("of before", encoding="utf-8")
        with self.assertRaisesRegex((SystemExit, OSError), message):
            self.write(draw)
        self.assertEqual([path.name for path in self.pages.iterdir()], ["index.md"])
        self.assertEqual({path.name for path in self.folder.iterdir()}, {"runs", "gallery"})

    def test_a_run_that_is_missing_leaves_the_pages_as_they_were(self):
        shutil.rmtree(self.runs / list(gallery.scenes())[-1])
        self.leaves_what_there_was("manifest.json is not there")

    def test_a_run_of_another_scene_leaves_the_pages_as_they_were(self):
        manifest = self.runs / "drop/simulate/manifest.json"
        text = manifest.read_text(encoding="utf-8")
        manifest.write_text(re.sub(r'"sha256": "\w+"', '"sha256": "0"', text), encoding="utf-8")
        self.leaves_what_there_was("of another scene")

    def test_a_picture_that_fails_leaves_the_pages_as_they_were(self):
        def draw(_folder, _scene, _view, picture):
            if picture.stem == list(gallery.scenes())[-1]:
                raise OSError("no display")
            picture.write_bytes(b"a picture")

        self.leaves_what_there_was("no display", draw)

    def test_a_picture_of_every_obstacle_is_drawn(self):
        """By gallery_picture.py, which needs what .packages lists under [gallery]."""
        python = "/usr/bin/python3"  # Debian's, as its VTK is
        if run("sh", "-c", f"command -v xvfb-run xauth && {python} -c 'import h5py, vtk'").returncode != 0:
            self.skipTest("a package of [gallery] is not installed")
        done = run("xvfb-run", "-a", python, ROOT / "tests/docs/gallery_picture.py", self.folder)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)


if __name__ == "__main__":
    unittest.main()
