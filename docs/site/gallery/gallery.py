"""Writes the pages of the gallery from the runs of configs/gallery.yaml.

    gallery.py RUNS TO

RUNS is the folder that `viscera run configs/gallery.yaml` wrote, TO the folder to write: a picture and a
page for each scene, and an index. The words of a scene stand in NAME.md beside this file, what its
picture shows in views.json; what it costs is what its run measured. TO is replaced when all is done: a
run that is missing, or that was of another scene than the one in configs/, ends this with 1 and a
message, and leaves TO as it was.
"""
import hashlib
import json
import pathlib
import re
import shutil
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[2]
SPEC = ROOT / "configs/gallery.yaml"
MS_PER_S = 1000.0


def refuse(message):
    sys.exit(f"gallery: {message}")


def scenes():
    """The scene file of every case of the spec, in its order."""
    cases = SPEC.read_text(encoding="utf-8").split("\ncases:\n")[1]
    found = re.findall(r"^  (\w+): +\{scene: ([\w/]+\.yaml)", cases, re.M)
    return {name: SPEC.parent / scene for name, scene in found}


def run_of(folder, scene):
    """The manifest of a simulation, which has to be of this scene file."""
    manifest = folder / "manifest.json"
    if not manifest.is_file():
        refuse(f"{manifest} is not there: viscera run configs/gallery.yaml makes it")
    manifest = json.loads(manifest.read_text(encoding="utf-8"))
    ran = next(file["sha256"] for file in manifest["inputs"] if file["role"] == "scene")
    if ran != hashlib.sha256(scene.read_bytes()).hexdigest():
        refuse(f"{folder} is of another scene than {scene} is now: viscera run configs/gallery.yaml")
    return manifest


def cost_of(manifest, scene_json):
    """What a page says of the cost, as pairs of a heading and a text."""
    metrics = {metric["name"]: metric["value"] for metric in manifest["metrics"]}
    frame_ms, frame_s = metrics["frame_ms_median"], scene_json["time"]["frame"]
    share = frame_ms / (MS_PER_S * frame_s)
    simulated_s = (metrics["frames"] - 1) * frame_s  # the first frame is the start
    return {"tets": str(metrics["tets"]),
            "substeps a frame": str(metrics["substeps"]),
            "a frame takes (median)": f"{frame_ms:.1f} ms",
            "of real time": f"{100 * share:.0f} %",
            "simulated": f"{simulated_s:.2f} s",
            "computed in": f"{manifest['wall_s']:.1f} s"}


def table(rows):
    """Of rows that have the same keys; numbers stand on the right."""
    heads = list(rows[0])
    marks = ["---" if head == "scene" else "---:" for head in heads]
    lines = [heads, marks] + [list(row.values()) for row in rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def machine_of(manifest):
    model = next(metric["value"] for metric in manifest["metrics"] if metric["name"] == "cpu_model")
    return f"{model} ({manifest['device']})"


def words_of(name):
    """Title and text of a scene."""
    words = HERE / f"{name}.md"
    if not words.is_file():
        refuse(f"the scene {name} has no words: write {words}")
    title, _, text = words.read_text(encoding="utf-8").partition("\n")
    return title.removeprefix("# "), text.strip()


def page_of(name, scene, manifest, cost):
    title, text = words_of(name)
    effects = next(metric["value"] for metric in manifest["metrics"] if metric["name"] == "effects_on")
    links = ", ".join(f"[{effect}](../effects/{effect}.md)" for effect in effects)
    file = scene.relative_to(ROOT).as_posix()
    return (f"# {title}\n\n![{title}]({name}.png)\n\n{text}\n\nEffects: {links}.\n\n"
            f"## Cost\n\n{table([cost])}\nMeasured on {machine_of(manifest)}.\n\n"
            f"## Scene\n\n[{file}](../project/{file}); to run it and have its report:\n\n"
            f"```sh\nbuild/bin/viscera run configs/gallery.yaml --case {name}\n```\n\n"
            f"```yaml\n{scene.read_text(encoding='utf-8').strip()}\n```\n")


def index_of(rows, machines):
    pictures = "\n".join(f"## [{title}]({name}.md)\n\n[![{title}]({name}.png)]({name}.md)\n"
                         for name, title, _ in rows)
    costs = table([{"scene": f"[{title}]({name}.md)"} | cost for name, title, cost in rows])
    return (f"# Gallery\n\n{len(rows)} scenes on the phantom, run by [configs/gallery.yaml]"
            "(../project/configs/gallery.yaml) and drawn by `make gallery`: the surface of the deformed "
            "body over a shadow of the body at rest, obstacles in grey. Below 100 % of real time a "
            "scene is computed faster than it happens.\n\n"
            f"{costs}\nMeasured on {', '.join(sorted(machines))}.\n\n{pictures}")


def write(runs, to, draw):
    """`draw(folder, scene_json, view, picture)` makes a picture."""
    views = json.loads((HERE / "views.json").read_text(encoding="utf-8"))
    to.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=to.parent) as folder:
        made = pathlib.Path(folder) / to.name
        made.mkdir()
        rows, machines = [], set()
        for name, scene in scenes().items():
            simulation = runs / name / "simulate"
            manifest = run_of(simulation, scene)
            scene_json = json.loads((simulation / "scene.json").read_text(encoding="utf-8"))
            cost = cost_of(manifest, scene_json)
            page = page_of(name, scene, manifest, cost)
            (made / f"{name}.md").write_text(page, encoding="utf-8")
            draw(simulation, scene_json, views[name], made / f"{name}.png")
            rows.append((name, words_of(name)[0], cost))
            machines.add(machine_of(manifest))
        (made / "index.md").write_text(index_of(rows, machines), encoding="utf-8")
        shutil.rmtree(to, ignore_errors=True)
        made.rename(to)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    import draw  # needs VTK and h5py, which the pages alone do not

    write(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]).resolve(), draw.draw)
