"""The page of a simulation, made without the programs."""

import html
import json
import os
import pathlib
import tempfile
from collections.abc import Mapping
from typing import Any

from . import _report, _viscera, file_of
from ._viscera import TetMesh


class Report:
    """The page that viscera-report makes of a run.

    html: the page, which opens from disk and loads nothing. summary: a dict with the verdict, gates, metrics and the
    last values of all series, as in summary.json. Notebooks show the page itself.
    """

    def __init__(self, page: str, summary: dict[str, Any]) -> None:
        self.html = page
        self.summary = summary

    def save(self, file: str | os.PathLike[str]) -> None:
        """Writes the page."""
        pathlib.Path(file).write_text(self.html, encoding="utf-8")

    def _repr_html_(self) -> str:
        return f"<iframe style='width:100%;height:800px;border:0' srcdoc='{html.escape(self.html, quote=True)}'></iframe>"

    def __repr__(self) -> str:
        verdict = self.summary["verdict"]
        return f"<viscera.Report: {verdict['state']}, {verdict['gates_passed']} gates passed, {verdict['gates_failed']} failed>"


def report(mesh: TetMesh, scene: str | os.PathLike[str] | Mapping[str, Any], *, title: str | None = None,
           max_frames: int = 120, **params: Any) -> Report:
    """Simulates a scene from its start to its end and makes the page of it: what viscera-simulate and viscera-report do.

    mesh: with the gates that it was made with, where it was. scene and params: as those of Simulation; with
    certify=True the page begins with how far the body at rest is off. max_frames: shown at most. Files stand
    in a temporary folder meanwhile. A gate that fails and a run that diverges are said on the page and in its summary;
    viscera.Error is raised where there is no result.
    """
    shown: dict[str, Any] = {"max_frames": max_frames, "gltf_frames": 0}
    if title is not None:
        shown["title"] = title
    _report.check(shown)  # before the simulation takes its time
    with tempfile.TemporaryDirectory(prefix="viscera-") as name, file_of(scene) as file:
        folder = pathlib.Path(name)
        _viscera.simulate_in_folder(mesh, file, params, folder)
        _report.report_in_folder({"mesh": folder / "mesh" / "mesh.vtu",
                                  "trajectory": folder / "simulate" / "trajectory.h5"}, shown, folder / "report")
        return Report((folder / "report" / "report.html").read_text(encoding="utf-8"),
                      json.loads((folder / "report" / "summary.json").read_text(encoding="utf-8")))
