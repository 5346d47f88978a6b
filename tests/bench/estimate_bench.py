"""What `viscera estimate` says of runs beside what they then take.

    estimate_bench.py BIN CSV MESH_TETS SCENE VOLUME…

Each volume of labels 1 (liver) and 2 (tumour) is meshed in MESH_TETS tets and simulated in SCENE, a
scene of configs/scenes, first estimated and then run; a row a stage with its seconds and megabytes.
"""
import csv
import json
import pathlib
import subprocess
import sys
import tempfile

SPEC = """viscera: 1
stages:
  labels: {{in: {{volume: '{volume}'}}, labels: {{liver: 1, tumour: 2}}, border: accept}}
  surface: {{}}
  tetmesh: {{target_tets: {tets}, regions: {{support: {{side: right, within: 80 mm}}}}}}
  simulate: {{in: {{scene: '{scene}'}}}}
  report: {{}}
"""


def answers(command):
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 5):  # 5: a gate failed, and all was written
        sys.exit(f"{' '.join(command)}: exit {done.returncode}\n{done.stderr}")
    return done.stdout


def rows_of(programs, volume, tets, scene):
    """Estimated and taken, of each stage of one volume."""
    with tempfile.TemporaryDirectory() as folder:
        spec = pathlib.Path(folder, "spec.yaml")
        link = pathlib.Path(folder, volume.name)
        link.symlink_to(volume.resolve())
        scene_copy = pathlib.Path(folder, "scene.yaml")
        scene_copy.write_text(scene.read_text())
        spec.write_text(SPEC.format(volume=link.name, tets=tets, scene=scene_copy.name))
        viscera, place = str(programs / "viscera"), ["--out", folder + "/out"]
        said = json.loads(answers([viscera, "estimate", str(spec), "--json", *place]))
        answers([viscera, "run", str(spec), "--quiet", *place])
        for stage in said["stages"]:
            made = json.loads(
                pathlib.Path(folder, "out/spec", stage["stage"], "manifest.json").read_text())
            yield {"body": volume.name.split(".")[0], "tets": tets, "scene": scene.stem,
                   "stage": stage["stage"], "low_s": round(stage["wall_s"][0], 2),
                   "high_s": round(stage["wall_s"][1], 2), "took_s": round(made["wall_s"], 2),
                   "estimated_mb": round(stage["memory_mb"]), "took_mb": round(made["max_rss_mb"]),
                   **frame_times(stage, made)}


def frame_times(stage, made):
    """ms a frame as estimated and as measured, where frames are what takes time."""
    if stage["stage"] != "simulate":
        return {"estimated_ms": "", "took_ms": ""}
    metrics = {metric["name"]: metric["value"] for metric in made["metrics"]}
    return {"estimated_ms": stage["words"][0].split()[0],
            "took_ms": round(1e3 * made["wall_s"] / metrics["frames"], 1)}


def main(programs, table, tets, scene, *volumes):
    rows = [row for count in tets.split(",") for volume in volumes
            for row in rows_of(pathlib.Path(programs), pathlib.Path(volume), int(count),
                               pathlib.Path(scene))]
    with open(table, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    for row in rows:
        print(*row.values())


if __name__ == "__main__":
    main(*sys.argv[1:])
