"""The documentation site's pages, made by docs/site/generate.py, held against the programs.

    site_test.py BIN
"""
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
SCENE_HEAD = "scene: 1\n"
MATERIALS = "materials: {liver: {E: 5 kPa, nu: 0.45, density: 1060 kg/m3}}\n"


def run(*command):
    return subprocess.run([str(part) for part in command], capture_output=True, text=True)


def generated(folder, site=SITE):
    return run(sys.executable, SITE / "generate.py", BIN, folder / "pages", site)


def prose(text):
    """Without blocks and spans of code."""
    text = re.sub(r"^```.*?^```$", "", text, flags=re.M | re.S)
    return re.sub(r"`[^`\n]*`", "", re.sub(r"^(?: {4}.*\n)+", "", text, flags=re.M))


class Site(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp())
        cls.addClassCleanup(shutil.rmtree, cls.folder)
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


if __name__ == "__main__":
    unittest.main()
